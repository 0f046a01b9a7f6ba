// Stage bake, harmonic method. CPU twin: transplat_core::bake::harmonic::bake_harmonic.
// draw_small / draw_large: heights of all occluders along a batch of directions. look_up: openness of all receivers towards them.
// The constants in capitals are written in front of this file.

struct HarmonicParameters {
    // Surfels of this dispatch.
    count: u32,
    resolution: u32,
    // Which batch of directions of this read-back, and batches in it.
    batch: u32,
    batches: u32,
}

struct MapFrame {
    right: vec4f,
    up: vec4f,
    direction: vec4f,
}

struct BakeSurfel {
    // Centre, and bias in w.
    position: vec4f,
    axis_a: vec4f,
    axis_b: vec4f,
    normal: vec4f,
}

@group(0) @binding(0) var<uniform> parameters: HarmonicParameters;
@group(0) @binding(1) var<uniform> frames: array<MapFrame, DIRECTION_BATCH>;
@group(0) @binding(2) var<storage, read> surfels: array<BakeSurfel>;
// Heights as ordered integers, [DIRECTION_BATCH][resolution][resolution]; 0 is empty.
@group(0) @binding(3) var<storage, read_write> maps: array<atomic<u32>>;
// The same maps, finished.
@group(0) @binding(4) var<storage, read> finished: array<u32>;
// Openness in bytes, [count][batches][DIRECTION_BATCH].
@group(0) @binding(5) var<storage, read_write> open: array<u32>;

// Keeps the order of floats, negative ones too; no float maps to 0.
fn ordered(height: f32) -> u32 {
    let bits = bitcast<u32>(height);
    return select(bits | 0x80000000u, ~bits, (bits & 0x80000000u) != 0u);
}

fn height_of(key: u32) -> f32 {
    if key == 0u {
        return EMPTY;
    }
    return bitcast<f32>(select(~key, key & 0x7fffffffu, (key & 0x80000000u) != 0u));
}

struct Footprint {
    // Where the centre is on the map, and its height.
    center: vec2f,
    height: f32,
    // The half axes on the map, and what they rise.
    a: vec2f,
    b: vec2f,
    rise: vec2f,
    inverse_det: f32,
    // Texels that may be covered: first, and one past the last.
    low: vec2i,
    high: vec2i,
}

fn footprint(surfel: BakeSurfel, frame: MapFrame) -> Footprint {
    var f: Footprint;
    let a = surfel.axis_a.xyz;
    let b = surfel.axis_b.xyz;
    f.a = vec2f(dot(a, frame.right.xyz), dot(a, frame.up.xyz));
    f.b = vec2f(dot(b, frame.right.xyz), dot(b, frame.up.xyz));
    let det = f.a.x * f.b.y - f.a.y * f.b.x;
    f.low = vec2i(0);
    f.high = vec2i(0);
    // Seen edge-on (or without area) it covers nothing.
    if abs(det) <= EDGE_ON * length(a) * length(b) {
        return f;
    }
    let p = surfel.position.xyz;
    f.center = vec2f(dot(p, frame.right.xyz), dot(p, frame.up.xyz));
    f.height = dot(p, frame.direction.xyz);
    f.rise = vec2f(dot(a, frame.direction.xyz), dot(b, frame.direction.xyz));
    f.inverse_det = 1.0 / det;
    let extent = sqrt(f.a * f.a + f.b * f.b);
    let texel = 2.0 / f32(parameters.resolution);
    let low = max(ceil((f.center - extent + 1.0) / texel - 0.5), vec2f(0.0));
    let high = min(floor((f.center + extent + 1.0) / texel - 0.5) + 1.0, vec2f(f32(parameters.resolution)));
    f.low = vec2i(low);
    f.high = max(vec2i(high), f.low);
    return f;
}

fn draw_texel(f: Footprint, x: i32, y: i32, map: u32) {
    let texel = 2.0 / f32(parameters.resolution);
    let d = (vec2f(f32(x), f32(y)) + 0.5) * texel - 1.0 - f.center;
    let s = (d.x * f.b.y - d.y * f.b.x) * f.inverse_det;
    let t = (d.y * f.a.x - d.x * f.a.y) * f.inverse_det;
    if s * s + t * t <= 1.0 {
        let height = f.height + s * f.rise.x + t * f.rise.y;
        let resolution = parameters.resolution;
        atomicMax(&maps[(map * resolution + u32(y)) * resolution + u32(x)], ordered(height));
    }
}

// A thread a surfel; for surfels of SMALL_TEXELS at most.
@compute @workgroup_size(WORKGROUP)
fn draw_small(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= parameters.count {
        return;
    }
    let f = footprint(surfels[id.x], frames[id.y]);
    for (var y = f.low.y; y < f.high.y; y++) {
        for (var x = f.low.x; x < f.high.x; x++) {
            draw_texel(f, x, y, id.y);
        }
    }
}

// A workgroup a surfel.
@compute @workgroup_size(WORKGROUP)
fn draw_large(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) lane: u32) {
    let f = footprint(surfels[group.x], frames[group.y]);
    let size = vec2u(f.high - f.low);
    for (var i = lane; i < size.x * size.y; i += WORKGROUP) {
        draw_texel(f, f.low.x + i32(i % size.x), f.low.y + i32(i / size.x), group.y);
    }
}

fn openness(surfel: BakeSurfel, frame: MapFrame, map: u32) -> f32 {
    let resolution = parameters.resolution;
    let texel = 2.0 / f32(resolution);
    let p = surfel.position.xyz;
    let center = vec2f(dot(p, frame.right.xyz), dot(p, frame.up.xyz));
    let height = dot(p, frame.direction.xyz);
    let facing = dot(surfel.normal.xyz, frame.direction.xyz);
    let cosine = select(1.0, -1.0, facing < 0.0) * max(abs(facing), MIN_SLOPE_COSINE);
    // The receiver's own plane: a neighbour in it is no occluder.
    let slope = -vec2f(dot(surfel.normal.xyz, frame.right.xyz), dot(surfel.normal.xyz, frame.up.xyz)) / cosine;
    let at = (center + 1.0) / texel;
    var taps = TAPS;
    var sum = 0.0;
    for (var i = 0u; i < TAP_COUNT; i++) {
        let cell = floor(at + taps[i]);
        if !(all(cell >= vec2f(0.0)) && all(cell < vec2f(f32(resolution)))) {
            sum += 1.0;
            continue;
        }
        let plane = height + dot(slope, (cell + 0.5) * texel - 1.0 - center);
        let key = finished[(map * resolution + u32(cell.y)) * resolution + u32(cell.x)];
        let above = height_of(key) - plane - surfel.position.w;
        sum += exp(-SHARPNESS * max(above, 0.0));
    }
    return sum / f32(TAP_COUNT);
}

@compute @workgroup_size(WORKGROUP)
fn look_up(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= parameters.count {
        return;
    }
    let surfel = surfels[id.x];
    const WORDS = DIRECTION_BATCH / 4u;
    for (var word = 0u; word < WORDS; word++) {
        var bytes = 0u;
        for (var i = 0u; i < 4u; i++) {
            let map = 4u * word + i;
            let value = u32(openness(surfel, frames[map], map) * 255.0 + 0.5);
            bytes |= value << (8u * i);
        }
        open[(id.x * parameters.batches + parameters.batch) * WORDS + word] = bytes;
    }
}
