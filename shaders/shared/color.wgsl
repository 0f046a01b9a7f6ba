// Transfer and tone curves. CPU twin: transplat_core::color. AGX_INSET, AGX_OUTSET and MAX_LINEAR are written in front of this file.

fn srgb_decode(encoded: vec3f) -> vec3f {
    let low = encoded / 12.92;
    let high = pow((encoded + 0.055) / 1.055, vec3f(2.4));
    return select(high, low, encoded <= vec3f(0.04045));
}

fn srgb_encode(linear: vec3f) -> vec3f {
    let low = linear * 12.92;
    let high = 1.055 * pow(linear, vec3f(1.0 / 2.4)) - 0.055;
    return select(high, low, linear <= vec3f(0.0031308));
}

fn neutral(c: vec3f) -> vec3f {
    const START = 0.8 - 0.04;
    let low = min(c.r, min(c.g, c.b));
    let offset = select(0.04, low - 6.25 * low * low, low < 0.08);
    let shifted = c - offset;
    let peak = max(shifted.r, max(shifted.g, shifted.b));
    if peak < START {
        return shifted;
    }
    const ROOM = 1.0 - START;
    let new_peak = 1.0 - ROOM * ROOM / (peak + ROOM - START);
    let white = 1.0 - 1.0 / (0.15 * (peak - new_peak) + 1.0);
    return mix(shifted * (new_peak / peak), vec3f(new_peak), white);
}

fn agx(c: vec3f) -> vec3f {
    const LOW = -12.47393;
    const HIGH = 4.026069;
    let x = clamp((log2(max(AGX_INSET * c, vec3f(1e-10))) - LOW) / (HIGH - LOW), vec3f(0.0), vec3f(1.0));
    let x2 = x * x;
    let x4 = x2 * x2;
    let curved = 15.5 * x4 * x2 - 40.14 * x4 * x + 31.96 * x4 - 6.868 * x2 * x + 0.4298 * x2 + 0.1191 * x - 0.00232;
    return clamp(AGX_OUTSET * curved, vec3f(0.0), vec3f(1.0));
}

fn display(exposed: vec3f, tone_map: u32) -> vec3f {
    let c = clamp(exposed, vec3f(0.0), vec3f(MAX_LINEAR));
    switch tone_map {
        case TONE_SRGB: {
            return srgb_encode(c);
        }
        case TONE_NEUTRAL: {
            return srgb_encode(neutral(c));
        }
        case TONE_AGX: {
            return agx(c);
        }
        case TONE_ACES: {
            let x = min(c, vec3f(1e6));
            return srgb_encode(clamp((x * (2.51 * x + 0.03)) / (x * (2.43 * x + 0.59) + 0.14), vec3f(0.0), vec3f(1.0)));
        }
        default: {
            return c;
        }
    }
}
