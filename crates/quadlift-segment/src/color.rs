//! Colors as the methods compare them: CIELAB, scaled.

use std::sync::LazyLock;

/// CIELAB of white point D65 divided by 100, of an sRGB color: lightness in [0, 1], the two color axes about
/// [-1, 1]. Distances follow the eye's ability to distinguish colors, and all axes have about the same scale.
pub(crate) fn scaled_lab([r, g, b]: [u8; 3]) -> [f32; 3] {
    static LINEAR: LazyLock<[f32; 256]> = LazyLock::new(|| {
        std::array::from_fn(|level| {
            let c = level as f32 / 255.0;
            if c <= 0.04045 { c / 12.92 } else { ((c + 0.055) / 1.055).powf(2.4) }
        })
    });
    let linear = &*LINEAR;
    let (r, g, b) = (linear[usize::from(r)], linear[usize::from(g)], linear[usize::from(b)]);
    // Linear sRGB to XYZ (IEC 61966-2-1), each divided by its value of white.
    let x = (0.412_453 * r + 0.357_580 * g + 0.180_423 * b) / 0.950_456;
    let y = 0.212_671 * r + 0.715_160 * g + 0.072_169 * b;
    let z = (0.019_334 * r + 0.119_193 * g + 0.950_227 * b) / 1.088_754;
    let [fx, fy, fz] = [x, y, z].map(|t| if t > 0.008_856 { t.cbrt() } else { 7.787 * t + 16.0 / 116.0 });
    [1.16 * fy - 0.16, 5.0 * (fx - fy), 2.0 * (fy - fz)]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn known_colors() {
        // Values of CIELAB (D65) from color tables, to their two decimals.
        let table = [
            ([255, 255, 255], [100.0, 0.0, 0.0]),
            ([0, 0, 0], [0.0, 0.0, 0.0]),
            ([128, 128, 128], [53.59, 0.0, 0.0]),
            ([255, 0, 0], [53.24, 80.09, 67.20]),
            ([0, 255, 0], [87.73, -86.18, 83.18]),
            ([0, 0, 255], [32.30, 79.19, -107.86]),
            ([10, 10, 10], [2.74, 0.0, 0.0]),
        ];
        for (rgb, expected) in table {
            let lab = scaled_lab(rgb);
            for (found, expected) in lab.iter().zip(expected) {
                assert!((100.0 * found - expected).abs() < 0.05f32, "{rgb:?}: {lab:?}");
            }
        }
    }
}
