//! How reliable a mask is, and when it is rejected.

/// Why a mask was replaced by the box's ellipse.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Failure {
    /// It covers too little of the box.
    TooSmall,
    /// It fills the box: no background was found.
    FillsTheBox,
    /// Much of it lies outside of the box.
    LeavesTheBox,
    /// It reaches over a part of the box only.
    MissesPartOfTheBox,
    /// The pixels of the box are hardly more likely to be one than the other.
    Undecided,
}

impl Failure {
    /// The reason as text, for a table or a message.
    pub fn name(self) -> &'static str {
        match self {
            Self::TooSmall => "too small",
            Self::FillsTheBox => "fills the box",
            Self::LeavesTheBox => "leaves the box",
            Self::MissesPartOfTheBox => "misses part of the box",
            Self::Undecided => "undecided",
        }
    }
}

/// Limits of the area of the mask over that of the box.
const MIN_AREA: f64 = 0.12;
const MAX_AREA: f64 = 0.97;
/// Largest part of the mask outside of the box.
const MAX_OUTSIDE: f64 = 0.12;
/// Smallest IoU of the mask's extent with the box.
const MIN_EXTENT: f64 = 0.55;
/// Smallest mean of `|2 q - 1|` in the box.
const MIN_DECIDED: f64 = 0.35;

/// The mean of `|2 q - 1|` over the pixels of the box that lie in the image, q being the probability of the object:
/// from 0 (nothing is known) to 1 (every pixel is certain).
pub(crate) fn decidedness(log_odds: &[f32], in_box: &[bool]) -> f64 {
    // |2 q - 1| = |tanh(log-odds / 2)|
    let pixels = log_odds.iter().zip(in_box).filter(|(_, in_box)| **in_box);
    let (count, total) = pixels.fold((0, 0.0), |(n, t), (l, _)| (n + 1, t + f64::from((0.5 * l).tanh().abs())));
    if count == 0 { 0.0 } else { total / f64::from(count) }
}

/// Why the mask is not trustworthy, if so. `in_box` are the pixels of the box that lie in the image.
pub(crate) fn failure(inside: &[bool], in_box: &[bool], decidedness: f64, grid: usize) -> Option<Failure> {
    let count = |pixels: &[bool]| pixels.iter().filter(|&&inside| inside).count() as f64;
    let (area, box_area) = (count(inside), count(in_box));
    let outside = inside.iter().zip(in_box).filter(|(inside, in_box)| **inside && !**in_box).count() as f64;
    if area < MIN_AREA * box_area || area == 0.0 {
        Some(Failure::TooSmall)
    } else if area > MAX_AREA * box_area {
        Some(Failure::FillsTheBox)
    } else if outside > MAX_OUTSIDE * area {
        Some(Failure::LeavesTheBox)
    } else if extent_iou(inside, in_box, grid) < MIN_EXTENT {
        Some(Failure::MissesPartOfTheBox)
    } else if decidedness.is_nan() || decidedness < MIN_DECIDED {
        Some(Failure::Undecided)
    } else {
        None
    }
}

/// Intersection over union of the smallest rectangles that hold the pixels of both.
fn extent_iou(a: &[bool], b: &[bool], grid: usize) -> f64 {
    let (Some(a), Some(b)) = (extent(a, grid), extent(b, grid)) else { return 0.0 };
    let area = |[x0, y0, x1, y1]: [usize; 4]| (x1.saturating_sub(x0) * y1.saturating_sub(y0)) as f64;
    let both = area([a[0].max(b[0]), a[1].max(b[1]), a[2].min(b[2]), a[3].min(b[3])]);
    both / (area(a) + area(b) - both)
}

fn extent(inside: &[bool], grid: usize) -> Option<[usize; 4]> {
    let places = || inside.iter().enumerate().filter(|(_, inside)| **inside).map(|(i, _)| (i % grid, i / grid));
    let xs = places().map(|(x, _)| x);
    let ys = places().map(|(_, y)| y);
    Some([xs.clone().min()?, ys.clone().min()?, xs.max()? + 1, ys.max()? + 1])
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The pixels of a rectangle on a grid of 10 pixels.
    fn rectangle(x0: usize, y0: usize, x1: usize, y1: usize) -> Vec<bool> {
        (0..100).map(|i| (x0..x1).contains(&(i % 10)) && (y0..y1).contains(&(i / 10))).collect()
    }

    #[test]
    fn each_failure_is_found() {
        let in_box = rectangle(1, 1, 9, 9);
        let check = |mask: &[bool], decided| failure(mask, &in_box, decided, 10);
        assert_eq!(check(&rectangle(2, 1, 9, 8), 0.9), None);
        assert_eq!(check(&rectangle(2, 1, 9, 8), 0.3), Some(Failure::Undecided));
        assert_eq!(check(&rectangle(2, 1, 9, 8), f64::NAN), Some(Failure::Undecided));
        assert_eq!(check(&rectangle(4, 4, 5, 6), 0.9), Some(Failure::TooSmall));
        assert_eq!(check(&rectangle(0, 0, 0, 0), 0.9), Some(Failure::TooSmall));
        assert_eq!(check(&rectangle(1, 1, 9, 9), 0.9), Some(Failure::FillsTheBox));
        assert_eq!(check(&rectangle(0, 1, 7, 8), 0.9), Some(Failure::LeavesTheBox));
        assert_eq!(check(&rectangle(1, 1, 9, 5), 0.9), Some(Failure::MissesPartOfTheBox));
    }

    #[test]
    fn certainty_is_between_zero_and_one() {
        let in_box = rectangle(1, 1, 9, 9);
        assert_eq!(decidedness(&[0.0; 100], &in_box), 0.0);
        assert!((decidedness(&[-50.0; 100], &in_box) - 1.0).abs() < 1e-6);
        // q = 0.9: 2 q - 1 = 0.8.
        let odds = (0.9f32 / 0.1).ln();
        assert!((decidedness(&[odds; 100], &in_box) - 0.8).abs() < 1e-6);
        assert_eq!(decidedness(&[1.0; 100], &[false; 100]), 0.0);
    }
}
