// Stage rasterize: SH to the colour of each surfel. CPU twin: transplat_core::rasterize::shade.
// K, sh_basis and the display curves come from in front of this file.

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
    unused_a: u32,
    unused_b: u32,
}

@group(0) @binding(0) var<uniform> parameters: ShadeParameters;
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
    for (var k = 0u; k < K; k++) {
        let at = start + 3u * k;
        value += basis[k] * vec3f(sh[at], sh[at + 1u], sh[at + 2u]);
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
