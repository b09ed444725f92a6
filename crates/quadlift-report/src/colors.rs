//! The colors of objects, as in the page (`viewer/src/colors.ts`).

use crate::data::Report;

/// A color: red, green, blue.
pub(crate) type Color = [u8; 3];

/// Paul Tol's bright scheme with four more colors; gray is for detections without an object.
const PALETTE: [Color; 10] = [
    [0x44, 0x77, 0xaa],
    [0xee, 0x66, 0x77],
    [0x22, 0x88, 0x33],
    [0xcc, 0xbb, 0x44],
    [0x66, 0xcc, 0xee],
    [0xaa, 0x33, 0x77],
    [0xee, 0x88, 0x66],
    [0x44, 0xbb, 0x99],
    [0x94, 0x67, 0xbd],
    [0x8c, 0x61, 0x3c],
];
/// Detections without an object.
pub(crate) const UNKNOWN: Color = [0x88; 3];

/// The color of an object by its index.
pub(crate) fn of_object(index: usize) -> Color {
    PALETTE[index % PALETTE.len()]
}

impl Report {
    /// The color of an object: by category if there are several, otherwise by object.
    pub fn color(&self, index: usize) -> Color {
        let category = self.objects.get(index).map_or(-1, |object| object.category);
        match self.categories.len() {
            0 | 1 => of_object(index),
            _ => usize::try_from(category).map_or(UNKNOWN, |category| PALETTE[category % PALETTE.len()]),
        }
    }
}
