// A view, surfels, and surfels on the screen. CPU twin: transplat_core::rasterize.

struct View {
    // Rows of the rotation from world to view: right, down, forward; in w the eye's position.
    right: vec4f,
    down: vec4f,
    forward: vec4f,
    // Focal length in pixels, near depth, and the principal point.
    focal: f32,
    near: f32,
    principal: vec2f,
    // What depth is divided by, so that half floats hold it; and the origin of the tile that is drawn.
    depth_unit: f32,
    // What 1 in the surfels' own unit is in that of depths.
    scale: f32,
    origin: vec2f,
    // Size of the tile; first surfel and count of this dispatch.
    tile: vec2f,
    first: u32,
    count: u32,
}

struct Surfel {
    // Centre, and opacity in w.
    position: vec4f,
    // Standard deviation times unit tangent; in w of the first the thickness: 0 of a surfel, below 0 of an antialiased Gaussian.
    axis_a: vec4f,
    axis_b: vec4f,
}

struct ProjectedSurfel {
    // Rows of the map from the surfel's plane to homogeneous pixels; in w the low-pass centre (x, y) and the opacity.
    t_u: vec4f,
    t_v: vec4f,
    t_w: vec4f,
    // Least and greatest pixel that it can touch; empty where it is not seen.
    bounds: vec4f,
}
