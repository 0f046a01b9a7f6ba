// Stage bake, directional method: what the rays of a stratum of directions hit. CPU twin: transplat_core::bake::directional.
// One thread a surfel and stratum. The constants in capitals are written in front of this file.

#import shared/trace

struct DirectionalParameters {
    // Surfels of this dispatch.
    count: u32,
    box_count: u32,
}

struct DirectionalBakeSurfel {
    // Scaled for the rays, with its smaller and larger standard deviation.
    position: vec3f,
    minor: f32,
    // Towards the front.
    normal: vec3f,
    major: f32,
}

@group(0) @binding(0) var<uniform> parameters: DirectionalParameters;
// First direction of each stratum of this dispatch, before the others.
@group(0) @binding(1) var<uniform> directions: array<vec4f, RAYS>;
@group(0) @binding(2) var<storage, read> surfels: array<DirectionalBakeSurfel>;
// Whether the back of a surfel is closed. [count]
@group(0) @binding(6) var<storage, read> closed: array<u32>;
// The surfel that the first ray meets in the low SURFEL_BITS, above them which rays are open, and HAS_MET. [STRATUM_BATCH][count]
@group(0) @binding(5) var<storage, read_write> found: array<u32>;

// Whether the first ray was traced and met a surfel.
const HAS_MET = 1u << 31u;

@compute @workgroup_size(WORKGROUP)
fn trace_strata(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= parameters.count {
        return;
    }
    let surfel = surfels[id.x];
    var result = 0u;
    for (var place = 0u; place < PER_STRATUM; place++) {
        let d = directions[PER_STRATUM * id.y + place].xyz;
        if closed[id.x] == 1u && dot(surfel.normal, d) < 0.0 {
            continue;
        }
        let extent = vec2f(surfel.minor, surfel.major);
        let hit = trace(surfel.position, surfel.normal, extent, d, place > 0u, parameters.box_count);
        if hit == MISS {
            result |= 1u << (SURFEL_BITS + place);
        } else if place == 0u {
            result |= extractBits(hit, 0u, SURFEL_BITS) | HAS_MET;
        }
    }
    found[id.y * parameters.count + id.x] = result;
}
