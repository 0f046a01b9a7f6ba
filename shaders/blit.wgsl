// Stage present: the finished picture to its place in the window, scaled while quality is stepped down.

@group(0) @binding(0) var picture: texture_2d<f32>;
@group(0) @binding(1) var picture_sampler: sampler;

struct Corner {
    @builtin(position) position: vec4f,
    @location(0) at: vec2f,
}

@vertex
fn corner(@builtin(vertex_index) vertex: u32) -> Corner {
    let at = vec2f(f32(vertex & 1u), f32(vertex >> 1u)) * 2.0;
    var out: Corner;
    out.at = at;
    out.position = vec4f(at.x * 2.0 - 1.0, 1.0 - at.y * 2.0, 0.5, 1.0);
    return out;
}

@fragment
fn blit(in: Corner) -> @location(0) vec4f {
    return textureSampleLevel(picture, picture_sampler, in.at, 0.0);
}
