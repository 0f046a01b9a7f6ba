// Rays against discs in a hierarchy of boxes. CPU twin: transplat_core::visibility::trace.
// The boxes come in an order that needs no stack. BOX_BINDING and DISC_BINDING are written in front of this file.

struct TraceBox {
    low: vec3f,
    // What follows all that is in it.
    skip: u32,
    high: vec3f,
    // First disc in the low 28 bits, and how many; none where it holds boxes.
    discs: u32,
}

struct TraceDisc {
    center: vec3f,
    surfel: u32,
    normal: vec3f,
    unused_a: u32,
    // Half axes over their squared lengths.
    axis_a: vec3f,
    unused_b: u32,
    axis_b: vec3f,
    unused_c: u32,
}

@group(0) @binding(BOX_BINDING) var<storage, read> boxes: array<TraceBox>;
@group(0) @binding(DISC_BINDING) var<storage, read> discs: array<TraceDisc>;

const MISS = 0xffffffffu;

// Where a ray starts that leaves a surfel: on the side that it goes to.
fn ray_origin(position: vec3f, bias: f32, normal: vec3f, d: vec3f) -> vec3f {
    return position + normal * (select(1.0, -1.0, dot(normal, d) < 0.0) * START_SCALES * bias);
}

// The surfel that a ray meets first beyond `nearest`, or any that it meets, or MISS.
fn trace(origin: vec3f, d: vec3f, nearest: f32, any_will_do: bool, box_count: u32) -> u32 {
    // A direction along an axis never divides by zero.
    let safe = select(d, select(vec3f(1e-12), vec3f(-1e-12), d < vec3f(0.0)), abs(d) < vec3f(1e-12));
    let inverse = 1.0 / safe;
    var farthest = 3.4e38;
    var hit = MISS;
    var i = 0u;
    while i < box_count {
        let here = boxes[i];
        let a = (here.low - origin) * inverse;
        let b = (here.high - origin) * inverse;
        let near = min(a, b);
        let far = max(a, b);
        let enter = max(max(near.x, near.y), max(near.z, 0.0));
        let leave = min(min(far.x, far.y), min(far.z, farthest));
        if enter > leave {
            i = here.skip;
            continue;
        }
        let first = here.discs & 0xfffffffu;
        let end = first + (here.discs >> 28u);
        for (var k = first; k < end; k++) {
            let disc = discs[k];
            let facing = dot(disc.normal, d);
            let from_center = origin - disc.center;
            let t = -dot(from_center, disc.normal) / facing;
            let at = from_center + t * d;
            let u = dot(at, disc.axis_a);
            let v = dot(at, disc.axis_b);
            if abs(facing) >= 1e-6 && u * u + v * v <= 1.0 && t > nearest && t < farthest {
                farthest = t;
                hit = disc.surfel;
                if any_will_do {
                    return hit;
                }
            }
        }
        i++;
    }
    return hit;
}
