// Stage rasterize: surfels to the screen. CPU twin: transplat_core::rasterize::project_surfel.
// MIN_ALPHA and WORKGROUP are written in front of this file.

#import shared/surfel

@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<storage, read> surfels: array<Surfel>;
@group(0) @binding(2) var<storage, read_write> projected: array<ProjectedSurfel>;

struct EllipseBox {
    center: vec2f,
    half: vec2f,
    ok: bool,
}

fn ellipse_box(t_u: vec3f, t_v: vec3f, t_w: vec3f, r2: f32) -> EllipseBox {
    let t = vec3f(r2, r2, -1.0);
    let d = dot(t, t_w * t_w);
    var out: EllipseBox;
    out.ok = d <= -1e-12 * t_w.z * t_w.z;
    if out.ok {
        let f = t / d;
        out.center = vec2f(dot(f, t_u * t_w), dot(f, t_v * t_w));
        let square = vec2f(dot(f, t_u * t_u), dot(f, t_v * t_v));
        out.half = sqrt(max(out.center * out.center - square, vec2f(1e-8)));
    }
    return out;
}

@compute @workgroup_size(WORKGROUP)
fn project_surfels(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= view.count {
        return;
    }
    let surfel = surfels[id.x];
    var out: ProjectedSurfel;
    out.bounds = vec4f(1.0, 1.0, 0.0, 0.0);
    let opacity = surfel.position.w;
    let rotation = transpose(mat3x3f(view.right.xyz, view.down.xyz, view.forward.xyz));
    let eye = vec3f(view.right.w, view.down.w, view.forward.w);
    let p = rotation * (surfel.position.xyz - eye);
    if opacity > MIN_ALPHA && p.z > view.near {
        let a = rotation * surfel.axis_a.xyz;
        let b = rotation * surfel.axis_b.xyz;
        let t_w = view.scale * vec3f(a.z, b.z, p.z);
        let t_u = view.scale * view.focal * vec3f(a.x, b.x, p.x) + view.principal.x * t_w;
        let t_v = view.scale * view.focal * vec3f(a.y, b.y, p.y) + view.principal.y * t_w;
        // Where alpha falls to 1/255: u^2 + v^2 = 2 ln(255 opacity).
        let r2 = 2.0 * log(max(opacity / MIN_ALPHA, 1.0001));
        let exact = ellipse_box(t_u, t_v, t_w, r2);
        if exact.ok {
            let nine = ellipse_box(t_u, t_v, t_w, 9.0);
            let center = select(exact.center, nine.center, nine.ok);
            let reach = sqrt(r2 / 2.0);
            out.t_u = vec4f(t_u, center.x);
            out.t_v = vec4f(t_v, center.y);
            out.t_w = vec4f(t_w, opacity);
            out.bounds = vec4f(
                min(exact.center - exact.half, center - reach),
                max(exact.center + exact.half, center + reach),
            );
        }
    }
    projected[view.first + id.x] = out;
}
