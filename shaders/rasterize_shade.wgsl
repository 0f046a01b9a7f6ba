// Stage rasterize: the colour of each surfel. CPU twins: transplat_core::rasterize::shade, and present::normal_colors, tau_colors.
// K and sh_basis are written in front of this file.

#import shared/color

struct ShadeParameters {
    // In w the exposure as a factor.
    eye: vec4f,
    // First surfel of this dispatch in `colors`, and count.
    first: u32,
    count: u32,
    // ENCODING_*, and 1 where colour stays linear.
    encoding: u32,
    linear: u32,
    // TONE_*
    tone_map: u32,
    // 1 where stored colour is shown untouched.
    identity: u32,
    // The bands that take part: first coefficient, and one past the last.
    first_coefficient: u32,
    end_coefficient: u32,
}

// In storage: lavapipe compiles a uniform that decides on the flow into the pass, anew at each dispatch, and never frees that.
@group(0) @binding(0) var<storage, read> parameters: ShadeParameters;
@group(0) @binding(1) var<storage, read> positions: array<vec4f>;
// [count][K][3]
@group(0) @binding(2) var<storage, read> sh: array<f32>;
@group(0) @binding(3) var<storage, read_write> colors: array<vec4f>;

@compute @workgroup_size(WORKGROUP)
fn shade(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= parameters.count {
        return;
    }
    let towards = positions[id.x].xyz - parameters.eye.xyz;
    let size = length(towards);
    let d = select(vec3f(0.0, 0.0, 1.0), towards / size, size > 0.0);
    var basis = sh_basis(d);
    var value = vec3f(0.0);
    let start = id.x * K * 3u;
    // Bounds that are constants unroll; software drivers index `basis` slowly otherwise.
    for (var k = 0u; k < K; k++) {
        let at = start + 3u * k;
        let takes_part = k >= parameters.first_coefficient && k < parameters.end_coefficient;
        value += select(0.0, basis[k], takes_part) * vec3f(sh[at], sh[at + 1u], sh[at + 2u]);
    }
    if parameters.encoding != ENCODING_LINEAR {
        value += STORED_OFFSET;
    }
    value = max(value, vec3f(0.0));
    if parameters.identity == 0u {
        if parameters.encoding == ENCODING_STORED {
            value = srgb_decode(min(value, vec3f(MAX_STORED)));
        }
        if parameters.linear == 0u {
            value = display(value * parameters.eye.w, parameters.tone_map);
        }
    }
    colors[parameters.first + id.x] = vec4f(value, 0.0);
}

// Normal of each surfel, [count].
@group(0) @binding(4) var<storage, read> normals: array<vec4f>;

@compute @workgroup_size(WORKGROUP)
fn shade_normals(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= parameters.count {
        return;
    }
    let n = normals[id.x].xyz;
    let away = dot(n, positions[id.x].xyz - parameters.eye.xyz) > 0.0;
    colors[parameters.first + id.x] = vec4f(select(n, -n, away) * 0.5 + 0.5, 0.0);
}

fn heat(ratio: vec3f) -> vec4f {
    let mean = (ratio.x + ratio.y + ratio.z) / 3.0;
    let stops = clamp(log2(max(mean, 1e-6)) / 3.0, -1.0, 1.0);
    let cold = vec3f(1.0 + 0.9 * stops, 1.0 + 0.7 * stops, 1.0);
    let warm = vec3f(1.0, 1.0 - 0.75 * stops, 1.0 - 0.9 * stops);
    return vec4f(select(warm, cold, stops < 0.0), 0.0);
}

// Linear DC of the asset, [count].
@group(0) @binding(5) var<storage, read> source_dc: array<vec4f>;

// Of the relit `sh`.
@compute @workgroup_size(WORKGROUP)
fn shade_tau(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= parameters.count {
        return;
    }
    let at = id.x * K * 3u;
    let relit = vec3f(sh[at], sh[at + 1u], sh[at + 2u]);
    let dc = source_dc[id.x].xyz;
    let tau = select(vec3f(0.0), relit / dc, dc > vec3f(0.0));
    colors[parameters.first + id.x] = heat(tau);
}

// Ratio of the front and of the back, [count][2].
@group(0) @binding(7) var<storage, read> ratio: array<vec4f>;

@compute @workgroup_size(WORKGROUP)
fn shade_ratio(@builtin(global_invocation_id) id: vec3u) {
    if id.x < parameters.count {
        colors[parameters.first + id.x] = heat(ratio[2u * id.x].xyz);
    }
}

// Marks to be laid over the colours, with how much of them in w, [count].
@group(0) @binding(6) var<storage, read> marks: array<vec4f>;

@compute @workgroup_size(WORKGROUP)
fn overlay(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= parameters.count {
        return;
    }
    let mark = marks[id.x];
    let i = parameters.first + id.x;
    colors[i] = mix(colors[i], vec4f(mark.rgb, 0.0), mark.w);
}
