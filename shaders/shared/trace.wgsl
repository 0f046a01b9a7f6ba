// Rays against discs in a hierarchy of boxes. CPU twin: transplat_core::bake::trace.
// The boxes come in an order that needs no stack. *_SCALES are written in front of this file. Its bindings have numbers that no shader takes for its own.

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
    // Towards the front.
    normal: vec3f,
    // 1 where it is seen from its front alone.
    one_sided: u32,
    // Half axes over their squared lengths.
    axis_a: vec4f,
    axis_b: vec4f,
}

@group(0) @binding(20) var<storage, read> boxes: array<TraceBox>;
@group(0) @binding(21) var<storage, read> discs: array<TraceDisc>;


// The surfel that a ray from a surfel meets first, or any that it meets, or MISS. `normal` points to the surfel's front; `extent` is its
// smaller and its larger standard deviation.
fn trace(position: vec3f, normal: vec3f, extent: vec2f, d: vec3f, any_will_do: bool, box_count: u32) -> u32 {
    let in_front = dot(normal, d) >= 0.0;
    let origin = position + normal * (select(-1.0, 1.0, in_front) * START_SCALES * extent.x);
    // From where on the ray meets anything, and discs that it leaves through their fronts.
    let nearest = NEAREST_SCALES * extent.x;
    let stack = select(nearest, STACK_SCALES * extent.y, in_front);
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
            let u = dot(at, disc.axis_a.xyz);
            let v = dot(at, disc.axis_b.xyz);
            let least = select(nearest, stack, disc.one_sided == 1u && facing > 0.0);
            if abs(facing) >= 1e-6 && u * u + v * v <= 1.0 && t > least && t < farthest {
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
