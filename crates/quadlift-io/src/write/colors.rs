//! One color per category.

/// Colors that most people can distinguish (Okabe and Ito's, without black and white), as sRGB.
const PALETTE: [[u8; 3]; 7] =
    [[230, 159, 0], [86, 180, 233], [0, 158, 115], [213, 94, 0], [0, 114, 178], [204, 121, 167], [240, 228, 66]];

/// The color of camera frusta.
pub(super) const CAMERA: [u8; 3] = [110, 110, 110];

/// The color of the category with this index; they repeat after seven.
pub(super) fn of_category(index: usize) -> [u8; 3] {
    PALETTE[index % PALETTE.len()]
}

/// An sRGB color as linear light, which glTF wants.
pub(super) fn linear(srgb: [u8; 3]) -> [f64; 3] {
    srgb.map(|byte| {
        let x = f64::from(byte) / 255.0;
        if x <= 0.04045 { x / 12.92 } else { ((x + 0.055) / 1.055).powf(2.4) }
    })
}
