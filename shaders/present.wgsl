// Stage present: from pictures of surfels to the picture on the screen. CPU twins: transplat_core::present and transplat_core::ground.
// The constants in capitals are written in front of this file: what a picture does not need is compiled out, since a driver that computes on the
// CPU goes through all that is there.

#import shared/color

struct PresentParameters {
    // Rows of the rotation from the asset to the view. In w: focal length, backdrop's focal length, depth unit.
    view: array<vec4f, 3>,
    // In w the exposure as a factor.
    eye: vec4f,
    // Rows of the turn from the asset to the map of the source light (behind what is as captured), in w its gain per channel; and the same
    // of the target light (behind what is relit).
    maps: array<array<vec4f, 3>, 2>,
    // Middle of the ground, and half its edge.
    ground: vec4f,
    // Axes of the ground; in the second's w the spacing of the grid.
    ground_axes: array<vec4f, 2>,
    // Colours of the background; of a plate the share of its edges that a pixel is.
    colors: array<vec4f, 2>,
    // Size of the screen, and its principal point.
    size: vec2f,
    principal: vec2f,
    // Nearest and farthest depth.
    depth_range: vec2f,
    difference_scale: f32,
    wipe_column: u32,
}

// In storage for the reason that rasterize_shade.wgsl gives.
@group(0) @binding(0) var<storage, read> parameters: PresentParameters;
@group(0) @binding(1) var before_color: texture_2d<f32>;
@group(0) @binding(2) var after_color: texture_2d<f32>;
@group(0) @binding(3) var after_depth: texture_2d<f32>;
@group(0) @binding(4) var before_map: texture_2d<f32>;
@group(0) @binding(5) var after_map: texture_2d<f32>;
// Lit share of the ground under the source light, and under the target.
@group(0) @binding(6) var ground_before: texture_2d<f32>;
@group(0) @binding(7) var map_sampler: sampler;
@group(0) @binding(8) var ground_sampler: sampler;
@group(0) @binding(9) var ground_after: texture_2d<f32>;

// What each side is graded by. First for the curves, then for the cube: what its first entry stands for, with in w how many entries are along
// an edge (0: none), and what its last one does. Then the entries of both, red running fastest.
@group(0) @binding(10) var<storage, read> lut_before: array<vec4f>;
@group(0) @binding(11) var<storage, read> lut_after: array<vec4f>;

const PI = 3.14159265358979;

@vertex
fn corner(@builtin(vertex_index) vertex: u32) -> @builtin(position) vec4f {
    return vec4f(f32(vertex & 1u) * 4.0 - 1.0, f32(vertex >> 1u) * 4.0 - 1.0, 0.5, 1.0);
}

// Where a direction of the map lies in its picture, 0 to 1.
fn map_at(d: vec3f) -> vec2f {
    let u = 0.5 - atan2(d.y, d.x) / (2.0 * PI);
    return vec2f(u, acos(clamp(d.z, -1.0, 1.0)) / PI);
}

// Direction in the asset's coordinates of a pixel of one layer.
fn ray(at: vec2f, focal: f32) -> vec3f {
    let view = vec3f(at - parameters.principal, focal);
    let d = view.x * parameters.view[0].xyz + view.y * parameters.view[1].xyz + view.z * parameters.view[2].xyz;
    return normalize(d);
}

fn environment(at: vec2f, after: bool) -> vec3f {
    let d = ray(at, parameters.view[1].w);
    let map = parameters.maps[u32(after)];
    let there = map_at(vec3f(dot(map[0].xyz, d), dot(map[1].xyz, d), dot(map[2].xyz, d)));
    var radiance = vec3f(map[0].w, map[1].w, map[2].w);
    if after {
        radiance *= textureSampleLevel(after_map, map_sampler, there, 0.0).rgb;
    } else {
        radiance *= textureSampleLevel(before_map, map_sampler, there, 0.0).rgb;
    }
    return display(radiance * parameters.eye.w, TONE_MAP);
}

fn checkerboard(pixel: vec2f) -> vec4f {
    let square = vec2u(pixel) / CHECKER_EDGE;
    let odd = (square.x + square.y) % 2u == 1u;
    return vec4f(vec3f(select(CHECKER_GREYS.x, CHECKER_GREYS.y, odd)), 1.0);
}

fn background(pixel: vec2f, at: vec2f, after: bool) -> vec4f {
    switch BACKGROUND {
        case BACKGROUND_COLOR: {
            return vec4f(parameters.colors[0].rgb, 1.0);
        }
        case BACKGROUND_GRADIENT: {
            let t = pixel.y / parameters.size.y;
            return vec4f(mix(parameters.colors[0].rgb, parameters.colors[1].rgb, t), 1.0);
        }
        case BACKGROUND_ENVIRONMENT: {
            return vec4f(environment(at, after), 1.0);
        }
        case BACKGROUND_PLATE: {
            let there = 0.5 + (at - parameters.principal) * parameters.colors[0].xy;
            if any(there < vec2f(0.0)) || any(there > vec2f(1.0)) {
                return checkerboard(pixel);
            }
            // A photograph has edges where the sampler of maps goes round; OpenGL refuses a second sampler for one texture.
            let half_pixel = 0.5 / f32(textureDimensions(after_map).x);
            let inside = vec2f(clamp(there.x, half_pixel, 1.0 - half_pixel), there.y);
            let radiance = textureSampleLevel(after_map, map_sampler, inside, 0.0).rgb;
            return vec4f(clamp(srgb_encode(radiance), vec3f(0.0), vec3f(1.0)), 1.0);
        }
        default: {
            // And on a screen what shows where a picture is transparent.
            return checkerboard(pixel);
        }
    }
}

// What lies between background and object: the caught shadow, and the grid.
fn with_ground(behind: vec4f, at: vec2f, after: bool) -> vec4f {
    if !CATCHES_SHADOWS && !HAS_GRID {
        return behind;
    }
    let d = ray(at, parameters.view[0].w);
    let normal = cross(parameters.ground_axes[0].xyz, parameters.ground_axes[1].xyz);
    let falls = dot(d, normal);
    let height = dot(parameters.eye.xyz - parameters.ground.xyz, normal);
    let meets = height / -falls;
    let p = parameters.eye.xyz + d * meets - parameters.ground.xyz;
    let on_plane = vec2f(dot(p, parameters.ground_axes[0].xyz), dot(p, parameters.ground_axes[1].xyz));
    var out = behind;
    if CATCHES_SHADOWS && height > 0.0 && falls < -1e-6 {
        let uv = on_plane / parameters.ground.w;
        let rim = max(abs(uv.x), abs(uv.y));
        if rim < 1.0 {
            let lit_before = textureSampleLevel(ground_before, ground_sampler, uv * 0.5 + 0.5, 0.0).r;
            let lit_after = textureSampleLevel(ground_after, ground_sampler, uv * 0.5 + 0.5, 0.0).r;
            let lit = select(lit_before, lit_after, after);
            let fade = clamp((1.0 - rim) / (1.0 - GROUND_FADE), 0.0, 1.0);
            let shadow = fade * (1.0 - pow(lit, 1.0 / 2.2));
            out = vec4f(out.rgb * (1.0 - shadow), shadow + out.a * (1.0 - shadow));
        }
    }
    let spacing = parameters.ground_axes[1].w;
    if HAS_GRID && meets > 0.0 {
        // A pixel's width on the plane, which grows with distance and towards the horizon.
        let pixel_width = meets / parameters.view[0].w / max(abs(falls), 0.02);
        let far = clamp(1.0 - length(on_plane) / (24.0 * spacing), 0.0, 1.0);
        let from_line = abs(on_plane / spacing - round(on_plane / spacing)) * spacing;
        let lines = max(vec2f(0.0), 1.0 - from_line / pixel_width);
        let axes = max(vec2f(0.0), 1.0 - abs(on_plane) / (1.5 * pixel_width));
        // Where lines come closer than pixels, they are left out.
        let fine = clamp(spacing / (4.0 * pixel_width) - 0.5, 0.0, 1.0);
        let grey = 0.35 * fine * far * max(lines.x, lines.y);
        out = vec4f(mix(out.rgb, vec3f(0.5), grey), out.a);
        out = vec4f(mix(out.rgb, vec3f(0.75, 0.3, 0.3), 0.7 * far * axes.y), out.a);
        out = vec4f(mix(out.rgb, vec3f(0.35, 0.65, 0.3), 0.7 * far * axes.x), out.a);
    }
    return out;
}

fn over(front: vec4f, behind: vec4f) -> vec4f {
    return front + (1.0 - front.a) * behind;
}

fn false_color(encoded: vec3f) -> vec3f {
    let luminance = dot(srgb_decode(max(encoded, vec3f(0.0))), vec3f(0.2126, 0.7152, 0.0722));
    let stops = log2(max(luminance, 1e-9) / 0.18);
    var table = FALSE_COLORS;
    var color = table[FALSE_COLOR_COUNT - 1u].rgb;
    for (var i = FALSE_COLOR_COUNT - 1u; i > 0u; i--) {
        if stops < table[i - 1u].w {
            color = table[i - 1u].rgb;
        }
    }
    return color;
}

const LUT_HEADER = 4u;

fn lut_at(i: u32, after: bool) -> vec4f {
    if after {
        return lut_after[i];
    }
    return lut_before[i];
}

// Where a colour lies in one of the tables, in entries.
fn lut_place(color: vec3f, table: u32, after: bool) -> vec3f {
    let first = lut_at(2u * table, after);
    let last = lut_at(2u * table + 1u, after);
    return clamp((color - first.xyz) / (last.xyz - first.xyz), vec3f(0.0), vec3f(1.0)) * (first.w - 1.0);
}

// CPU twin: transplat_core::lut.
fn grade(color: vec3f, after: bool) -> vec3f {
    var out = color;
    let curve = u32(lut_at(0u, after).w);
    if curve > 0u {
        let place = lut_place(out, 0u, after);
        let below = min(floor(place), vec3f(f32(curve - 2u)));
        for (var c = 0u; c < 3u; c++) {
            let at = LUT_HEADER + u32(below[c]);
            out[c] = mix(lut_at(at, after)[c], lut_at(at + 1u, after)[c], place[c] - below[c]);
        }
    }
    let edge = u32(lut_at(2u, after).w);
    if edge > 0u {
        let place = lut_place(out, 1u, after);
        let below = min(floor(place), vec3f(f32(edge - 2u)));
        let far = place - below;
        let strides = vec3u(1u, edge, edge * edge);
        // From the lowest corner to the highest, the channel that is farthest first.
        var order = vec3u(0u, 1u, 2u);
        if far[order.x] < far[order.y] {
            order = order.yxz;
        }
        if far[order.y] < far[order.z] {
            order = order.xzy;
        }
        if far[order.x] < far[order.y] {
            order = order.yxz;
        }
        let corner = vec3u(below) * strides;
        var at = LUT_HEADER + curve + corner.x + corner.y + corner.z;
        var last = lut_at(at, after).xyz;
        out = last;
        for (var i = 0u; i < 3u; i++) {
            at += strides[order[i]];
            let next = lut_at(at, after).xyz;
            out += (next - last) * far[order[i]];
            last = next;
        }
    }
    return out;
}

@fragment
fn present(@builtin(position) position: vec4f) -> @location(0) vec4f {
    let pixel = vec2i(position.xy);
    let size = vec2i(parameters.size);
    // Which picture, and where in it.
    var after = true;
    var at = pixel;
    if ARRANGEMENT == LAYOUT_BEFORE {
        after = false;
    }
    if ARRANGEMENT == LAYOUT_SPLIT {
        if pixel.x == i32(parameters.wipe_column) && size.x > 2 {
            return WIPE_LINE;
        }
        after = pixel.x >= i32(parameters.wipe_column);
    }
    if ARRANGEMENT == LAYOUT_SIDE_BY_SIDE {
        let half = size.x / 2;
        after = pixel.x >= half;
        at.x = select(pixel.x, pixel.x - half, after);
    }
    var front: vec4f;
    if after {
        front = textureLoad(after_color, at, 0);
    } else {
        front = textureLoad(before_color, at, 0);
    }
    if ARRANGEMENT == LAYOUT_DIFFERENCE {
        let before = textureLoad(before_color, at, 0);
        let value = 0.5 * front.a + parameters.difference_scale * (front.rgb - before.rgb);
        front = vec4f(clamp(value, vec3f(0.0), vec3f(front.a)), front.a);
    }
    if ARRANGEMENT == LAYOUT_DEPTH {
        let depth = textureLoad(after_depth, at, 0).r * parameters.view[2].w / max(front.a, 1e-9);
        let range = parameters.depth_range;
        let value = clamp(1.0 - 0.8 * (depth - range.x) / (range.y - range.x), 0.0, 1.0);
        front = vec4f(vec3f(value) * front.a, front.a);
    }
    let behind = with_ground(background(position.xy, vec2f(at), after), vec2f(at), after);
    var out = over(front, behind).rgb;
    if IS_GRADED {
        out = grade(out, after);
    }
    if FALSE_COLORED {
        out = false_color(out);
    }
    return vec4f(clamp(out, vec3f(0.0), vec3f(1.0)), 1.0);
}
