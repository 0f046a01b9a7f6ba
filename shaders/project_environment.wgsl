// Stage project environment. CPU twin: transplat_core::environment::project_environment.
// One workgroup a row of the map: Fourier sums over azimuth, then every coefficient of the row. Rows are summed in f64 afterwards.
// DEGREE and K = (DEGREE + 1)^2 are written in front of this file.

struct ProjectParameters {
    width: u32,
    // First row of this dispatch, counted in the whole map.
    first_row: u32,
}

@group(0) @binding(0) var<uniform> parameters: ProjectParameters;
// Radiance of the rows of this dispatch, [rows][width][3].
@group(0) @binding(1) var<storage, read> pixels: array<f32>;
// Cosine and sine of each column's azimuth, [width].
@group(0) @binding(2) var<storage, read> azimuths: array<vec2f>;
// Solid angle times q(l,m) sin^m(theta) of each row of the map, [height][K].
@group(0) @binding(3) var<storage, read> row_weights: array<f32>;
// [height][K][3]
@group(0) @binding(4) var<storage, read_write> row_sums: array<f32>;

// Lanes that share a row; their sums fit the workgroup's memory at any degree.
const LANES = 32u;
const WAVES = 2u * (DEGREE + 1u);
var<workgroup> partial: array<vec3f, LANES * WAVES>;

@compute @workgroup_size(LANES)
fn project_rows(
    @builtin(workgroup_id) group: vec3u,
    @builtin(local_invocation_index) lane: u32,
) {
    let row = group.x;
    var sums: array<vec3f, WAVES>;
    for (var column = lane; column < parameters.width; column += LANES) {
        let at = 3u * (row * parameters.width + column);
        let radiance = vec3f(pixels[at], pixels[at + 1u], pixels[at + 2u]);
        let base = azimuths[column];
        var wave = vec2f(1.0, 0.0);
        for (var m = 0u; m <= DEGREE; m++) {
            sums[2u * m] += radiance * wave.x;
            sums[2u * m + 1u] += radiance * wave.y;
            wave = vec2f(wave.x * base.x - wave.y * base.y, wave.y * base.x + wave.x * base.y);
        }
    }
    for (var i = 0u; i < WAVES; i++) {
        partial[lane * WAVES + i] = sums[i];
    }
    workgroupBarrier();
    if lane < WAVES {
        var sum = vec3f(0.0);
        for (var other = 0u; other < LANES; other++) {
            sum += partial[other * WAVES + lane];
        }
        // Slot `lane` of the first lane's part is read by this lane alone.
        partial[lane] = sum;
    }
    workgroupBarrier();
    let map_row = parameters.first_row + row;
    for (var k = lane; k < K; k += LANES) {
        let l = u32(sqrt(f32(k) + 0.5));
        let m = i32(k) - i32(l * l + l);
        let wave = 2u * u32(abs(m)) + select(0u, 1u, m < 0);
        let value = row_weights[map_row * K + k] * partial[wave];
        let at = 3u * (map_row * K + k);
        row_sums[at] = value.x;
        row_sums[at + 1u] = value.y;
        row_sums[at + 2u] = value.z;
    }
}
