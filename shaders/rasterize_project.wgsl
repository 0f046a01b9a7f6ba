// Stage rasterize: surfels and 3D Gaussians to the screen. CPU twin: transplat_core::rasterize::project_surfel.
// MIN_ALPHA, LOW_PASS_VARIANCE, MARGIN, LEAST_COMPENSATION, NOWHERE and WORKGROUP are written in front of this file.

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

// However short it is.
fn unit(v: vec3f) -> vec3f {
    let size = max(abs(v.x), max(abs(v.y), abs(v.z)));
    return normalize(v / size);
}

// Around the centre the projection is taken for linear: `a`, `b`, `c` are the axes in the view.
fn project_gaussian(p: vec3f, a: vec3f, b: vec3f, c: vec3f, peak: f32, is_antialiased: bool) -> ProjectedSurfel {
    var out: ProjectedSurfel;
    out.bounds = vec4f(1.0, 1.0, 0.0, 0.0);
    let limit = MARGIN * (view.principal + 0.5) / view.focal;
    let slope = p.xy / p.z;
    let held = clamp(slope, -limit, limit);
    let to_pixels = view.focal / p.z;
    let screen_a = to_pixels * (a.xy - held * a.z);
    let screen_b = to_pixels * (b.xy - held * b.z);
    let screen_c = to_pixels * (c.xy - held * c.z);
    let x = vec3f(screen_a.x, screen_b.x, screen_c.x);
    let y = vec3f(screen_a.y, screen_b.y, screen_c.y);
    let wide = vec2f(dot(x, x), dot(y, y)) + LOW_PASS_VARIANCE;
    // Without cancellation (Cauchy and Binet), however long and thin it is.
    let minors = cross(x, y);
    let sharp = dot(minors, minors);
    let determinant = sharp + LOW_PASS_VARIANCE * (wide.x + wide.y - LOW_PASS_VARIANCE);
    let compensation = sqrt(max(sharp / determinant, LEAST_COMPENSATION));
    let opacity = select(peak, peak * compensation, is_antialiased);
    if opacity > MIN_ALPHA && determinant < 1e38 {
        let center = view.focal * slope + view.principal;
        let r2 = 2.0 * log(max(opacity / MIN_ALPHA, 1.0001));
        let half = sqrt(r2 * wide);
        let root = sqrt(wide.x);
        let depth = view.scale * p.z;
        out.t_u = vec4f(depth * vec3f(root, 0.0, center.x), NOWHERE);
        out.t_v = vec4f(depth * vec3f(dot(x, y) / root, sqrt(determinant / wide.x), center.y), NOWHERE);
        out.t_w = vec4f(0.0, 0.0, depth, opacity);
        out.bounds = vec4f(center - half, center + half);
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
        let thickness = surfel.axis_a.w;
        if thickness != 0.0 {
            let c = abs(thickness) * normalize(cross(unit(a), unit(b)));
            projected[view.first + id.x] = project_gaussian(p, a, b, c, opacity, thickness < 0.0);
            return;
        }
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
