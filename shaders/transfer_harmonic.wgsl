// Stage transfer, harmonic method. CPU twin: transplat_core::transfer::harmonic.
// One thread a surfel. What depends on the degrees is written out straight by the host in front of this file (straight lines
// run far faster than loops over tables on a software driver): sh_basis, and prepare, shadow_light_*, irradiance and
// write_specular, which keep the surfel's visibility and shadowed light in private variables.

struct TransferSurfel {
    // Unit normal.
    normal: vec4f,
    // Linear DC over E_S + eps, per channel.
    dc_over_irradiance: vec4f,
}

// Surfels of this dispatch.
@group(0) @binding(0) var<uniform> count: u32;
@group(0) @binding(1) var<storage, read> surfels: array<TransferSurfel>;

// [K][count]
@group(0) @binding(2) var<storage, read> visibility: array<f32>;
// [bands][3][count]
@group(0) @binding(3) var<storage, read> attenuation: array<f32>;
// Linear radiance, [count][ASSET_K][3].
@group(0) @binding(4) var<storage, read_write> relit: array<f32>;

fn store(i: u32, k: u32, channel: u32, value: f32) {
    relit[(i * ASSET_K + k) * 3u + channel] = clamp(value, -MAX_RADIANCE, MAX_RADIANCE);
}

// One channel, from its shadowed light.
fn finish(i: u32, channel: u32, dc: f32, basis: array<f32, LIGHT_K>) {
    store(i, 0u, channel, dc * max(irradiance(basis), 0.0));
    write_specular(i, channel);
}

@compute @workgroup_size(WORKGROUP)
fn relight(@builtin(global_invocation_id) id: vec3u) {
    let i = id.x;
    if i >= count {
        return;
    }
    let surfel = surfels[i];
    let n = surfel.normal.xyz;
    let basis = sh_basis(n);
    let dc = surfel.dc_over_irradiance;
    prepare(i, n);
    // Straight out too: a loop over channels would make their operators' indices variable.
    shadow_light_0();
    finish(i, 0u, dc.x, basis);
    shadow_light_1();
    finish(i, 1u, dc.y, basis);
    shadow_light_2();
    finish(i, 2u, dc.z, basis);
}
