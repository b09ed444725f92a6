//! Label images: one number for each pixel, that of its object.

use std::collections::BTreeMap;

use image::{ImageBuffer, Luma};

use crate::mask::{Mask, MaskError};

/// An image whose pixels hold the number of an object, 0 where there is none. Images of 8 and of 16 bits and the
/// indices of palettes fit.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct LabelImage {
    width: u32,
    height: u32,
    values: Vec<u16>,
}

impl LabelImage {
    /// A checked label image; `values` row by row.
    ///
    /// # Errors
    /// [`MaskError::Length`] if there are not `width * height` values.
    pub fn new(width: u32, height: u32, values: Vec<u16>) -> Result<Self, MaskError> {
        if values.len() as u64 != u64::from(width) * u64::from(height) {
            return Err(MaskError::Length { found: values.len(), width, height });
        }
        Ok(Self { width, height, values })
    }

    /// Width in pixels.
    pub fn width(&self) -> u32 {
        self.width
    }

    /// Height in pixels.
    pub fn height(&self) -> u32 {
        self.height
    }

    /// The values row by row.
    pub fn values(&self) -> &[u16] {
        &self.values
    }

    /// The value of pixel (x, y); 0 outside of the image.
    pub fn value(&self, x: u32, y: u32) -> u16 {
        if x >= self.width {
            return 0;
        }
        self.values.get(y as usize * self.width as usize + x as usize).copied().unwrap_or(0)
    }

    /// The pixels with a value, in the smallest window that holds them.
    pub fn mask(&self, value: u16) -> Mask {
        self.mask_where(|v| v == value)
    }

    /// The pixels with any value but 0, in the smallest window that holds them.
    pub fn foreground(&self) -> Mask {
        self.mask_where(|v| v != 0)
    }

    fn mask_where(&self, inside: impl Fn(u16) -> bool) -> Mask {
        let inside = self.values.iter().map(|&value| inside(value)).collect();
        Mask { origin: [0, 0], width: self.width, height: self.height, inside }.trimmed()
    }

    /// The masks of all values but 0, each in the smallest window that holds it; one pass over the image for all.
    pub fn masks(&self) -> BTreeMap<u16, Mask> {
        let mut windows: BTreeMap<u16, [u32; 4]> = BTreeMap::new();
        for (row, y) in self.values.chunks_exact(self.width.max(1) as usize).zip(0..) {
            for (&value, x) in row.iter().zip(0..).filter(|(value, _)| **value != 0) {
                let window = windows.entry(value).or_insert([x, y, x + 1, y + 1]);
                *window = [window[0].min(x), window[1], window[2].max(x + 1), y + 1];
            }
        }
        let mask = |(value, [x0, y0, x1, y1]): (u16, [u32; 4])| {
            let inside = |column, row| self.value(x0 + column, y0 + row) == value;
            (value, Mask { origin: [x0, y0], ..Mask::from_fn(x1 - x0, y1 - y0, inside) })
        };
        windows.into_iter().map(mask).collect()
    }

    /// The image with 8 bits; `None` when a value is above 255.
    pub fn to_8_bit(&self) -> Option<ImageBuffer<Luma<u8>, Vec<u8>>> {
        let values: Result<Vec<u8>, _> = self.values.iter().map(|&value| u8::try_from(value)).collect();
        ImageBuffer::from_raw(self.width, self.height, values.ok()?)
    }
}

impl From<&ImageBuffer<Luma<u8>, Vec<u8>>> for LabelImage {
    fn from(image: &ImageBuffer<Luma<u8>, Vec<u8>>) -> Self {
        let values = image.pixels().map(|pixel| pixel.0[0].into()).collect();
        Self { width: image.width(), height: image.height(), values }
    }
}

impl From<&ImageBuffer<Luma<u16>, Vec<u16>>> for LabelImage {
    fn from(image: &ImageBuffer<Luma<u16>, Vec<u16>>) -> Self {
        let values = image.pixels().map(|pixel| pixel.0[0]).collect();
        Self { width: image.width(), height: image.height(), values }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn images_of_both_depths_are_read() {
        let values = [0, 9, 9, 0, 255, 9];
        let gray = ImageBuffer::from_raw(3, 2, values.to_vec()).unwrap();
        let labels = LabelImage::from(&gray);
        assert_eq!(labels, LabelImage::new(3, 2, values.map(u16::from).to_vec()).unwrap());
        assert_eq!((labels.value(1, 1), labels.value(3, 0), labels.value(0, 2)), (255, 0, 0));
        assert_eq!(labels.to_8_bit().unwrap(), gray);
        let deep = LabelImage::from(&ImageBuffer::from_raw(1, 2, vec![300u16, 2]).unwrap());
        assert_eq!((deep.value(0, 0), deep.to_8_bit()), (300, None));
        assert_eq!(deep.mask(300), Mask { origin: [0, 0], width: 1, height: 1, inside: vec![true] });
        assert_eq!(deep.mask(7).count(), 0);
        assert_eq!(labels.mask(9), Mask::new([1, 0], 2, 2, vec![true, true, false, true]).unwrap());
    }

    #[test]
    fn the_number_of_values_is_checked() {
        assert!(LabelImage::new(2, 2, vec![0; 3]).is_err());
        assert_eq!(LabelImage::new(0, 3, vec![]).unwrap().masks().len(), 0);
    }

    proptest! {
        #[test]
        fn the_masks_of_all_values_are_those_of_each_and_share_out_the_foreground(
            values in proptest::collection::vec(0..5u16, 42),
        ) {
            let labels = LabelImage::new(7, 6, values).unwrap();
            let masks = labels.masks();
            for (&value, mask) in &masks {
                prop_assert_eq!(&labels.mask(value), mask);
            }
            let total: usize = masks.values().map(Mask::count).sum();
            prop_assert_eq!(total, labels.foreground().count());
        }
    }
}
