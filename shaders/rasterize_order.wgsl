// Stage rasterize: the surfels that are seen, farthest first; of equal ones the last first. CPU twin: transplat_core::rasterize::depth_order.
//
// A radix sort from the lowest digit up. Each round counts the digits of each block of keys, sums the counts up over the blocks, and moves
// each key to its place; threads take KEYS neighbours each, so that equal digits keep their order without atomics.
// WORKGROUP, KEYS and DIGITS are written in front of this file.

#import shared/surfel

struct OrderParameters {
    // Keys, and blocks of WORKGROUP * KEYS of them.
    count: u32,
    blocks: u32,
    // Of the digit of this round.
    shift: u32,
    // Size of the picture.
    width: f32,
    height: f32,
}

// What an indirect draw takes.
struct DrawnQuads {
    vertices: u32,
    surfels: atomic<u32>,
    first_vertex: u32,
    first_surfel: u32,
}

@group(0) @binding(0) var<storage, read> parameters: OrderParameters;
@group(0) @binding(1) var<storage, read> projected: array<ProjectedSurfel>;
// Which surfels are left out, a bit each.
@group(0) @binding(2) var<storage, read> hidden: array<u32>;
// Keys with their surfels.
@group(0) @binding(3) var<storage, read> pairs: array<vec2u>;
@group(0) @binding(4) var<storage, read_write> moved: array<vec2u>;
// How often each block has each digit, then how often those before it do: [DIGITS][blocks]; and how often all do.
@group(0) @binding(5) var<storage, read_write> counts: array<u32>;
@group(0) @binding(6) var<storage, read_write> totals: array<u32>;
@group(0) @binding(7) var<storage, read_write> drawn: DrawnQuads;

// Behind all that is seen.
const UNSEEN = 0x7fffffffu;

var<workgroup> seen: atomic<u32>;

fn key_of(index: u32) -> u32 {
    let bounds = projected[index].bounds;
    let is_hidden = (hidden[index / 32u] >> (index % 32u) & 1u) == 1u;
    let on_screen = all(bounds.xy <= bounds.zw) && all(bounds.zw > vec2f(0.0))
        && all(bounds.xy < vec2f(parameters.width, parameters.height));
    if is_hidden || !on_screen {
        return UNSEEN;
    }
    // Positive floats sort as their bits do.
    return UNSEEN - bitcast<u32>(projected[index].t_w.z);
}

@compute @workgroup_size(WORKGROUP)
fn make_keys(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) thread: u32) {
    if thread == 0u {
        atomicStore(&seen, 0u);
    }
    workgroupBarrier();
    let first = group.x * WORKGROUP * KEYS + thread;
    var own = 0u;
    for (var i = 0u; i < KEYS; i++) {
        let at = first + i * WORKGROUP;
        if at < parameters.count {
            let index = parameters.count - 1u - at;
            let key = key_of(index);
            own += u32(key != UNSEEN);
            moved[at] = vec2u(key, index);
        }
    }
    atomicAdd(&seen, own);
    workgroupBarrier();
    if thread == 0u {
        atomicAdd(&drawn.surfels, atomicLoad(&seen));
    }
}

fn digit_of(key: u32) -> u32 {
    return key >> parameters.shift & (DIGITS - 1u);
}

var<workgroup> bins: array<atomic<u32>, DIGITS>;

@compute @workgroup_size(WORKGROUP)
fn count_digits(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) thread: u32) {
    if thread < DIGITS {
        atomicStore(&bins[thread], 0u);
    }
    workgroupBarrier();
    let first = group.x * WORKGROUP * KEYS + thread;
    for (var i = 0u; i < KEYS; i++) {
        let at = first + i * WORKGROUP;
        if at < parameters.count {
            atomicAdd(&bins[digit_of(pairs[at].x)], 1u);
        }
    }
    workgroupBarrier();
    if thread < DIGITS {
        counts[thread * parameters.blocks + group.x] = atomicLoad(&bins[thread]);
    }
}

var<workgroup> sums: array<u32, WORKGROUP>;

// One digit a workgroup.
@compute @workgroup_size(WORKGROUP)
fn sum_counts(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) thread: u32) {
    var before = 0u;
    for (var start = 0u; start < parameters.blocks; start += WORKGROUP) {
        let at = group.x * parameters.blocks + start + thread;
        let is_block = start + thread < parameters.blocks;
        var own = 0u;
        if is_block {
            own = counts[at];
        }
        sums[thread] = own;
        workgroupBarrier();
        for (var step = 1u; step < WORKGROUP; step *= 2u) {
            var lower = 0u;
            if thread >= step {
                lower = sums[thread - step];
            }
            workgroupBarrier();
            sums[thread] += lower;
            workgroupBarrier();
        }
        if is_block {
            counts[at] = before + sums[thread] - own;
        }
        before += sums[WORKGROUP - 1u];
        workgroupBarrier();
    }
    if thread == 0u {
        totals[group.x] = before;
    }
}

// Of each thread's keys and of those of the threads before it how many have each digit, two digits in a number: a block has fewer than 65536.
const PAIRS_OF_DIGITS = DIGITS / 2u;
var<workgroup> ranks: array<array<u32, WORKGROUP>, PAIRS_OF_DIGITS>;
var<workgroup> starts: array<u32, DIGITS>;

fn next_place(key: u32, thread: u32) -> u32 {
    let digit = digit_of(key);
    let half = 16u * (digit & 1u);
    let rank = ranks[digit / 2u][thread] >> half & 0xffffu;
    ranks[digit / 2u][thread] += 1u << half;
    return starts[digit] + rank;
}

// Before it each thread's first place among the keys of its digit is in `ranks`, and where the block's own start in `starts`.
fn rank_keys(block: u32, thread: u32) {
    for (var p = 0u; p < PAIRS_OF_DIGITS; p++) {
        ranks[p][thread] = 0u;
    }
    let first = (block * WORKGROUP + thread) * KEYS;
    for (var i = 0u; i < KEYS; i++) {
        if first + i < parameters.count {
            let digit = digit_of(pairs[first + i].x);
            ranks[digit / 2u][thread] += 1u << (16u * (digit & 1u));
        }
    }
    if thread < DIGITS {
        var before = counts[thread * parameters.blocks + block];
        for (var digit = 0u; digit < thread; digit++) {
            before += totals[digit];
        }
        starts[thread] = before;
    }
    var own: array<u32, PAIRS_OF_DIGITS>;
    for (var p = 0u; p < PAIRS_OF_DIGITS; p++) {
        own[p] = ranks[p][thread];
    }
    workgroupBarrier();
    for (var step = 1u; step < WORKGROUP; step *= 2u) {
        var lower: array<u32, PAIRS_OF_DIGITS>;
        for (var p = 0u; p < PAIRS_OF_DIGITS; p++) {
            lower[p] = 0u;
            if thread >= step {
                lower[p] = ranks[p][thread - step];
            }
        }
        workgroupBarrier();
        for (var p = 0u; p < PAIRS_OF_DIGITS; p++) {
            ranks[p][thread] += lower[p];
        }
        workgroupBarrier();
    }
    for (var p = 0u; p < PAIRS_OF_DIGITS; p++) {
        ranks[p][thread] -= own[p];
    }
}

@compute @workgroup_size(WORKGROUP)
fn move_keys(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) thread: u32) {
    rank_keys(group.x, thread);
    let first = (group.x * WORKGROUP + thread) * KEYS;
    for (var i = 0u; i < KEYS; i++) {
        if first + i < parameters.count {
            let pair = pairs[first + i];
            moved[next_place(pair.x, thread)] = pair;
        }
    }
}
