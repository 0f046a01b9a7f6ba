// Stage rasterize: blends surfels back to front. CPU twin: transplat_core::rasterize::hit.
// MIN_ALPHA, MAX_ALPHA and MAX_COLOR (what the target holds) are written in front of this file.

#import shared/surfel

@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<storage, read> projected: array<ProjectedSurfel>;
// Colour of each surfel.
@group(0) @binding(2) var<storage, read> colors: array<vec4f>;
// What orders them, and surfels: farthest first.
@group(0) @binding(3) var<storage, read> order: array<vec2u>;

struct Corner {
    @builtin(position) position: vec4f,
    @location(0) @interpolate(flat) t_u: vec4f,
    @location(1) @interpolate(flat) t_v: vec4f,
    @location(2) @interpolate(flat) t_w: vec4f,
    @location(3) @interpolate(flat) color: vec3f,
}

@vertex
fn corner(@builtin(vertex_index) vertex: u32, @builtin(instance_index) instance: u32) -> Corner {
    let index = order[instance].y;
    let surfel = projected[index];
    var out: Corner;
    out.t_u = surfel.t_u;
    out.t_v = surfel.t_v;
    out.t_w = surfel.t_w;
    out.color = colors[index].rgb;
    if surfel.bounds.x > surfel.bounds.z {
        // Not seen: a corner outside of the picture, the same for all four.
        out.position = vec4f(2.0, 2.0, 2.0, 1.0);
        return out;
    }
    // Held to the tile, so that huge boxes keep their precision. Pixel centres are at integers.
    let low = clamp(surfel.bounds.xy - view.origin, vec2f(-1.0), view.tile);
    let high = clamp(surfel.bounds.zw - view.origin, vec2f(-1.0), view.tile);
    let pick = vec2f(f32(vertex & 1u), f32(vertex >> 1u));
    let pixel = mix(low, high, pick) + 0.5;
    let ndc = pixel / view.tile * vec2f(2.0, -2.0) + vec2f(-1.0, 1.0);
    out.position = vec4f(ndc, 0.5, 1.0);
    return out;
}

struct Blended {
    // Premultiplied colour, and alpha.
    @location(0) color: vec4f,
    // Depth times alpha, and alpha.
    @location(1) depth: vec4f,
}

fn blended(in: Corner) -> Blended {
    let pixel = in.position.xy - 0.5 + view.origin;
    let k = pixel.x * in.t_w.xyz - in.t_u.xyz;
    let l = pixel.y * in.t_w.xyz - in.t_v.xyz;
    let q = cross(k, l);
    let offset = vec2f(in.t_u.w, in.t_v.w) - pixel;
    var rho = 2.0 * dot(offset, offset);
    var depth = in.t_w.z;
    if q.z != 0.0 {
        let uv = q.xy / q.z;
        let on_plane = dot(uv, uv);
        if on_plane <= rho {
            rho = on_plane;
            depth = dot(uv, in.t_w.xy) + in.t_w.z;
        }
    }
    let alpha = min(MAX_ALPHA, in.t_w.w * exp(-0.5 * rho));
    if depth <= view.near || alpha < MIN_ALPHA {
        discard;
    }
    let color = min(in.color, vec3f(MAX_COLOR));
    return Blended(vec4f(color * alpha, alpha), vec4f(depth / view.depth_unit * alpha, 0.0, 0.0, alpha));
}

@fragment
fn shade_pixel(in: Corner) -> Blended {
    return blended(in);
}

// Where nobody asks for depth.
@fragment
fn shade_color(in: Corner) -> @location(0) vec4f {
    return blended(in).color;
}
