// Stage transfer, directional method. CPU twin: transplat_core::transfer::directional.
// Entry points in their order: see_suns (where there are any), gather, bounce (TURNS times), finish, add_back (where a surfel has two
// sides). One thread a surfel of a chunk; what others radiate is read from all chunks.
// In front of this file the host writes the constants in capitals and, straight out for the asset's degree: mirror_all, which mirrors
// the SH function in `s`; clear_lobes and add_ray, which keep the mirrored light at the nodes in private variables; fit_nodes and write.

#import shared/color
#import shared/trace

struct DirectionalChunk {
    count: u32,
    // Which of all surfels is the first one.
    first: u32,
}

struct DirectionalSettings {
    // Added to all irradiance, and what the bounces start from.
    least: vec3f,
    suns: u32,
    start: vec3f,
    box_count: u32,
    // Which parts of the colour are wanted, 0 or 1.
    diffuse: f32,
    mirrored: f32,
    residual: f32,
    // Blocker of a direction whose stratum has no surfel: times the surfel's own radiance.
    near: f32,
    shadow: u32,
    two_sided: u32,
    // Power to which a change of diffuse light is taken.
    trust: f32,
    unused: u32,
    // And what it is multiplied by then.
    undamped: vec3f,
    unused_b: u32,
}

struct DirectionalLightSample {
    // Unit vector towards the source.
    direction: vec3f,
    unused_a: u32,
    // Radiance times solid angle.
    energy: vec3f,
    unused_b: u32,
}

struct DirectionalSurfel {
    // Unit normal of the surface, towards the front.
    normal: vec3f,
    two_sided: f32,
    // Scaled for the rays, with the smaller and the larger standard deviation, and the surfel's own normal.
    position: vec3f,
    minor: f32,
    own_normal: vec3f,
    major: f32,
    // Irradiance under the source on each side; where the surfel's hits begin and end.
    front_divisor: vec3f,
    first_hit: u32,
    back_divisor: vec3f,
    end_hit: u32,
    // Mean linear colour of each side; the lobe's width, 0 where there is none.
    front_mean: vec3f,
    width: u32,
    back_mean: vec3f,
    has_fresnel: u32,
    reflectance: vec3f,
    // Share of emission in the diffuse colour.
    emission_share: f32,
    // Mean encoded colour that the model of the source has.
    encoded_mean: vec3f,
    unused_b: u32,
    // A bit a direction that is open.
    open: array<vec4u, OPEN_VECTORS>,
}

@group(0) @binding(0) var<uniform> chunk: DirectionalChunk;
@group(0) @binding(1) var<uniform> settings: DirectionalSettings;
// Suns, and from MAX_SUNS on the sky.
@group(0) @binding(2) var<uniform> light_samples: array<DirectionalLightSample, LIGHT_SAMPLES>;
@group(0) @binding(3) var<uniform> directions: array<vec4f, DIRECTIONS>;
@group(0) @binding(4) var<storage, read> surfels: array<DirectionalSurfel>;
// By stratum: the surfel in the low 24 bits, the stratum in the next 7, and the bit of a hit on its back.
@group(0) @binding(5) var<storage, read> hits: array<u32>;
// Irradiance of both sides; in w of the first which suns shine on it.
@group(0) @binding(8) var<storage, read_write> irradiance: array<vec4f>;
// Of both sides, for all surfels.
@group(0) @binding(9) var<storage, read> radiance: array<vec4f>;
@group(0) @binding(10) var<storage, read_write> next_radiance: array<vec4f>;
// How much the diffuse light of both sides changes; in w as above.
@group(0) @binding(11) var<storage, read_write> tau: array<vec4f>;
// [count][Q][3]
@group(0) @binding(12) var<storage, read> diffuse: array<f32>;
// [count][K][3]
@group(0) @binding(13) var<storage, read> residual: array<f32>;
@group(0) @binding(14) var<storage, read_write> relit: array<f32>;
@group(0) @binding(15) var<storage, read> stored: array<f32>;
// A bit a surfel of the chunk that nobody sees: its colour is not worked out.
@group(0) @binding(17) var<uniform> unseen: array<vec4u, UNSEEN_VECTORS>;
// Matrices of the nodes, at the offsets TABLE_*.
@group(0) @binding(16) var<storage, read> tables: array<f32>;

const STRATUM_SOLID_ANGLE = 12.566371 / f32(STRATA);
const SOLID_ANGLE = 12.566371 / f32(DIRECTIONS);

fn is_open(i: u32, direction: u32) -> bool {
    let word = direction / 32u;
    return (surfels[i].open[word / 4u][word % 4u] >> (direction % 32u) & 1u) == 1u;
}

fn is_unseen(i: u32) -> bool {
    return (unseen[i / 128u][i / 32u % 4u] >> (i % 32u) & 1u) == 1u;
}

fn radiance_of(hit: u32) -> vec3f {
    return radiance[2u * extractBits(hit, 0u, SURFEL_BITS) + (hit >> (SURFEL_BITS + STRATUM_BITS))].xyz;
}

fn stratum_of(hit: u32) -> u32 {
    return extractBits(hit, SURFEL_BITS, STRATUM_BITS);
}

@compute @workgroup_size(WORKGROUP)
fn see_suns(@builtin(global_invocation_id) id: vec3u) {
    let i = id.x;
    if i >= chunk.count {
        return;
    }
    let n = surfels[i].normal;
    let own_normal = surfels[i].own_normal;
    let extent = vec2f(surfels[i].minor, surfels[i].major);
    var front = vec3f(0.0);
    var back = vec3f(0.0);
    var seen = 0u;
    for (var k = 0u; k < settings.suns; k++) {
        let sun = light_samples[k];
        let cosine = dot(n, sun.direction);
        var open = settings.shadow == 0u;
        if !open && (cosine > 0.0 || surfels[i].two_sided > 0.0) {
            open = trace(surfels[i].position, own_normal, extent, sun.direction, true, settings.box_count) == MISS;
        }
        if open {
            seen |= 1u << k;
            front += max(cosine, 0.0) * sun.energy;
            back += max(-cosine, 0.0) * sun.energy;
        }
    }
    irradiance[2u * i] = vec4f(front, f32(seen));
    irradiance[2u * i + 1u] = vec4f(back, 0.0);
}

@compute @workgroup_size(WORKGROUP)
fn gather(@builtin(global_invocation_id) id: vec3u) {
    let i = id.x;
    if i >= chunk.count {
        return;
    }
    let n = surfels[i].normal;
    var front = vec4f(settings.least, 0.0);
    var back = front;
    if settings.suns > 0u {
        front += irradiance[2u * i];
        back += irradiance[2u * i + 1u];
    }
    for (var word = 0u; word < 4u * OPEN_VECTORS; word++) {
        let bits = surfels[i].open[word / 4u][word % 4u];
        for (var bit = 0u; bit < 32u; bit++) {
            let sky = light_samples[MAX_SUNS + 32u * word + bit];
            let cosine = select(0.0, dot(n, sky.direction), (bits >> bit & 1u) == 1u);
            front += vec4f(max(cosine, 0.0) * sky.energy, 0.0);
            back += vec4f(max(-cosine, 0.0) * sky.energy, 0.0);
        }
    }
    irradiance[2u * i] = front;
    irradiance[2u * i + 1u] = back;
    let all = 2u * (chunk.first + i);
    next_radiance[all] = vec4f(surfels[i].front_mean * settings.start, 0.0);
    next_radiance[all + 1u] = vec4f(surfels[i].back_mean * settings.start, 0.0);
}

// A change of diffuse light, as far as the source is known.
fn believed(change: vec3f, emission_share: vec3f) -> vec3f {
    return select(mix(settings.undamped, vec3f(1.0), emission_share) * pow(change, vec3f(settings.trust)), change, settings.trust >= 1.0);
}

@compute @workgroup_size(WORKGROUP)
fn bounce(@builtin(global_invocation_id) id: vec3u) {
    let i = id.x;
    if i >= chunk.count {
        return;
    }
    let n = surfels[i].normal;
    let end = surfels[i].end_hit;
    var front = irradiance[2u * i].xyz;
    var back = irradiance[2u * i + 1u].xyz;
    for (var k = surfels[i].first_hit; k < end; k++) {
        let hit = hits[k];
        let cosine = STRATUM_SOLID_ANGLE * dot(n, directions[stratum_of(hit)].xyz);
        let met = radiance_of(hit);
        front += max(cosine, 0.0) * met;
        back += max(-cosine, 0.0) * met;
    }
    let emission_share = vec3f(surfels[i].emission_share);
    let tau_front = mix(front / max(surfels[i].front_divisor, vec3f(LEAST_IRRADIANCE)), vec3f(1.0), emission_share);
    var tau_back = mix(back / max(surfels[i].back_divisor, vec3f(LEAST_IRRADIANCE)), vec3f(1.0), emission_share);
    if settings.two_sided == 0u {
        tau_back = tau_front;
    }
    tau[2u * i] = vec4f(believed(tau_front, emission_share), irradiance[2u * i].w);
    tau[2u * i + 1u] = vec4f(believed(tau_back, emission_share), 0.0);
    let all = 2u * (chunk.first + i);
    next_radiance[all] = vec4f(surfels[i].front_mean * tau_front, 0.0);
    next_radiance[all + 1u] = vec4f(surfels[i].back_mean * tau_back, 0.0);
}

// The mirror that exchanges a normal and the z axis.
fn frame_of(n: vec3f) -> vec3f {
    let difference = n - vec3f(0.0, 0.0, 1.0);
    let squared = dot(difference, difference);
    return select(vec3f(1.0, 0.0, 0.0), difference * inverseSqrt(max(squared, 1e-30)), squared > 1e-10);
}

fn reflected(d: vec3f, frame: vec3f) -> vec3f {
    return d - 2.0 * dot(d, frame) * frame;
}

fn encode(linear: vec3f) -> vec3f {
    var value = clamp(linear, vec3f(0.0), vec3f(MAX_LINEAR));
    if ENCODING == ENCODING_STORED {
        value = srgb_encode(value);
    }
    return value - OFFSET;
}

fn decode(value: vec3f) -> vec3f {
    let shown = max(value + OFFSET, vec3f(0.0));
    if ENCODING == ENCODING_STORED {
        return srgb_decode(min(shown, vec3f(MAX_STORED)));
    }
    return shown;
}

// All that shines on the front, a ray a stratum, and the suns.
fn add_rays(i: u32, n: vec3f, frame: vec3f) {
    let own = settings.near * SOLID_ANGLE * radiance[2u * (chunk.first + i)].xyz;
    let width = surfels[i].width;
    let end = surfels[i].end_hit;
    var next = surfels[i].first_hit;
    for (var p = 0u; p < STRATA; p++) {
        var met = own;
        if next < end && stratum_of(hits[next]) == p {
            met = SOLID_ANGLE * radiance_of(hits[next]);
            next++;
        }
        var energy = vec3f(0.0);
        var toward = vec3f(0.0);
        for (var j = p; j < DIRECTIONS; j += STRATA) {
            let direction = directions[j].xyz;
            if dot(n, direction) > 0.0 {
                let sky = light_samples[MAX_SUNS + j];
                let open = is_open(i, j);
                let e = select(met, sky.energy, open);
                energy += e;
                toward += (e.x + e.y + e.z) * select(direction, sky.direction, open);
            }
        }
        if energy.x + energy.y + energy.z > 0.0 {
            let d = toward / sqrt(max(dot(toward, toward), 1e-36));
            add_ray(reflected(d, frame), energy, width);
        }
    }
    let seen = u32(tau[2u * i].w);
    for (var k = 0u; k < settings.suns; k++) {
        let sun = light_samples[k];
        if (seen >> k & 1u) == 1u && dot(n, sun.direction) > 0.0 {
            add_ray(reflected(sun.direction, frame), sun.energy, width);
        }
    }
}

// By how much the residual changes with the encoded brightness.
fn residual_scale(now: vec3f, before: vec3f) -> vec3f {
    return select((now + RESIDUAL_FLOOR) / (before + RESIDUAL_FLOOR), now / before, now < before);
}

@compute @workgroup_size(WORKGROUP)
fn finish(@builtin(global_invocation_id) id: vec3u) {
    let i = id.x;
    if i >= chunk.count || is_unseen(i) {
        return;
    }
    let n = surfels[i].normal;
    let frame = frame_of(n);
    var reflectance = vec3f(0.0);
    clear_lobes();
    if surfels[i].width > 0u && settings.mirrored > 0.0 {
        reflectance = surfels[i].reflectance * ((f32(1u << surfels[i].width) + 1.0) / 12.566371);
        add_rays(i, n, frame);
    }
    let sum = fit_nodes(i, settings.diffuse * tau[2u * i].xyz, reflectance, surfels[i].has_fresnel == 1u);
    mirror_all(frame);
    var scale = vec3f(0.0);
    if settings.residual > 0.0 {
        scale = residual_scale(sum / f32(Q) + OFFSET, surfels[i].encoded_mean);
    }
    write(i, scale);
}

// Linear colour at a node, of the stored one in the surfel's frame, which is in `f`.
fn side_value(side: u32, node: u32) -> vec3f {
    var value = vec3f(0.0);
    for (var k = 0u; k < K; k++) {
        value += tables[TABLE_EVALUATE + (side * K + k) * Q + node] * f[k];
    }
    return decode(value);
}

// What changes of a two-sided surfel's colour because its back has a light of its own.
@compute @workgroup_size(WORKGROUP)
fn add_back(@builtin(global_invocation_id) id: vec3u) {
    let i = id.x;
    if i >= chunk.count || surfels[i].two_sided <= 0.0 || is_unseen(i) {
        return;
    }
    let frame = frame_of(surfels[i].normal);
    for (var k = 0u; k < K; k++) {
        let at = (i * K + k) * 3u;
        s[k] = vec3f(stored[at], stored[at + 1u], stored[at + 2u]);
    }
    mirror_all(frame);
    f = s;
    for (var k = 0u; k < K; k++) {
        s[k] = vec3f(0.0);
    }
    let front = settings.diffuse * tau[2u * i].xyz;
    let back = clamp(settings.diffuse * tau[2u * i + 1u].xyz, front / BACK_RANGE, front * BACK_RANGE);
    for (var side = 0u; side < 2u; side++) {
        for (var node = 0u; node < Q; node++) {
            let value = side_value(side, node);
            let height = tables[TABLE_HEIGHT + node];
            let share = surfels[i].two_sided * smoothstep(-HORIZON, HORIZON, select(-height, height, side == 1u));
            let change = encode(value * mix(front, back, share)) - encode(value * front);
            for (var k = 0u; k < K; k++) {
                s[k] += tables[TABLE_PROJECT + (side * Q + node) * K + k] * change;
            }
        }
    }
    mirror_all(frame);
    for (var k = 0u; k < K; k++) {
        let at = (i * K + k) * 3u;
        relit[at] += s[k].x;
        relit[at + 1u] += s[k].y;
        relit[at + 2u] += s[k].z;
    }
}
