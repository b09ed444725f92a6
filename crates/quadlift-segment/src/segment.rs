//! The entry point: crops of an object in, masks and ellipses out.

use nalgebra::Vector2;
use quadlift::geometry::Ellipse;
use quadlift::{Observer, Watch};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use crate::cleanup::clean;
use crate::confidence::{Failure, decidedness, failure};
use crate::crop::{Crop, CropOptions};
use crate::frames::Frames;
use crate::mask::Mask;
use crate::moments::{Moments, PixelTerm};
use crate::parallel::map_indices;
use crate::pooled::{Labeled, pooled_cuts};
use crate::sca::{self, ScaOptions};

/// How object and background are separated.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum SegmentMethod {
    /// Graph cuts with colors of all frames together and the prior of the box.
    #[default]
    GraphCut,
    /// Stel Component Analysis, as in the paper: a pixel is the object's when its posterior is above 1/2.
    Sca,
}

impl SegmentMethod {
    /// All of them, in the order of the documentation.
    pub const ALL: [Self; 2] = [Self::GraphCut, Self::Sca];

    /// The name on the command line and in tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::GraphCut => "graphcut",
            Self::Sca => "sca",
        }
    }
}

/// Options of a segmentation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SegmentOptions {
    /// The method.
    pub method: SegmentMethod,
    /// Settings of the method `sca`.
    pub sca: ScaOptions,
    /// Cost of a label that changes between neighbors of the same color, for `graphcut`; 0 to 100.
    pub smoothing: f64,
    /// Whether an unreliable mask is replaced by the ellipse in the box.
    pub fall_back: bool,
    /// Seed of all random numbers.
    pub seed: u64,
}

impl Default for SegmentOptions {
    fn default() -> Self {
        Self { method: SegmentMethod::default(), sca: ScaOptions::default(), smoothing: 2.0, fall_back: true, seed: 0 }
    }
}

/// Why crops cannot be segmented at all.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum SegmentError {
    /// An option is outside of its range.
    #[error("{0}")]
    Option(String),
    /// The crops of one object were cut in different ways.
    #[error(
        "the crops of an object were cut in different ways (a grid of {} with a margin of {}, and {} with {})",
        .0.grid, .0.margin, .1.grid, .1.margin
    )]
    CropsDiffer(CropOptions, CropOptions),
    /// The observer canceled the work.
    #[error("canceled")]
    Canceled,
}

/// The result for a view.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SegmentStatus {
    /// A mask was found, and the ellipse is that of its moments.
    Ok,
    /// No mask could be trusted: mask and ellipse are those of the box.
    Fallback(Failure),
}

/// The object in one view.
#[derive(Debug, Clone, PartialEq)]
pub struct ViewSegmentation {
    /// The pixels of the object in the image. Empty if the object is smaller than a pixel.
    pub mask: Mask,
    /// The ellipse with the second moments of the mask (or the one in the box), in pixels of the image.
    pub ellipse: Ellipse,
    /// From 0 (nothing is known beyond the box) to 1 (every pixel is certain).
    pub confidence: f64,
    /// Whether a mask was found.
    pub status: SegmentStatus,
}

/// Segments an object in its crops; one entry for each crop, in their order.
///
/// The frames are segmented jointly: the appearance of the object and of its surroundings is learned from all of them. The
/// result depends only on the crops and the options. All crops must have been cut with the same
/// [`CropOptions`]. Takes about 50 kilobytes for each crop while it works.
///
/// # Errors
/// [`SegmentError`] when options are outside of their ranges or crops were cut in different ways.
pub fn segment_object(crops: &[Crop], options: &SegmentOptions) -> Result<Vec<ViewSegmentation>, SegmentError> {
    check(crops, options)?;
    let Some(first) = crops.first() else { return Ok(Vec::new()) };
    let CropOptions { grid, margin } = *first.options();
    let frames = Frames::new(crops, grid, margin);
    let labeled = labeled(&frames, options);
    Ok(crops.iter().zip(labeled).map(|(crop, labeled)| view(crop, labeled, options.fall_back)).collect())
}

fn labeled(frames: &Frames, options: &SegmentOptions) -> Vec<Labeled> {
    let mut rng = ChaCha8Rng::seed_from_u64(options.seed);
    match options.method {
        SegmentMethod::GraphCut => pooled_cuts(frames, options.smoothing as f32, &mut rng),
        SegmentMethod::Sca => {
            let labels = |log_odds: Vec<f32>| Labeled { inside: log_odds.iter().map(|&x| x > 0.0).collect(), log_odds };
            sca::fit(frames, &options.sca, &mut rng).into_iter().map(labels).collect()
        }
    }
}

/// Segments many objects, each by its crops, in parallel; see [`segment_object`]. Where the observer cancels, the
/// objects that are left have the error [`SegmentError::Canceled`].
pub fn segment_objects(
    objects: &[Vec<Crop>],
    options: &SegmentOptions,
    observer: &dyn Observer,
) -> Vec<Result<Vec<ViewSegmentation>, SegmentError>> {
    let watch = Watch::new(observer, objects.len());
    map_indices(objects.len(), |index| {
        if watch.is_canceled() {
            return Err(SegmentError::Canceled);
        }
        let views = segment_object(&objects[index], options);
        watch.advance(1);
        views
    })
}

fn check(crops: &[Crop], options: &SegmentOptions) -> Result<(), SegmentError> {
    if let Some(problem) = options.sca.problem() {
        return Err(SegmentError::Option(problem));
    }
    if !(0.0..=100.0).contains(&options.smoothing) {
        return Err(SegmentError::Option(format!("the smoothing is {}; expected 0 to 100", options.smoothing)));
    }
    match crops.iter().find(|crop| crop.options() != crops[0].options()) {
        Some(other) => Err(SegmentError::CropsDiffer(*crops[0].options(), *other.options())),
        None => Ok(()),
    }
}

/// The result of a view from the labels of its grid.
fn view(crop: &Crop, labeled: Labeled, fall_back: bool) -> ViewSegmentation {
    let Labeled { log_odds, mut inside } = labeled;
    let grid = crop.grid();
    // A mask is a set of pixels of the image: pixels outside are never part of the object.
    let seen = crop.seen();
    inside.iter_mut().zip(&seen).for_each(|(inside, &seen)| *inside &= seen);
    clean(&mut inside, grid);
    let box_in_image: Vec<bool> = crop.in_box().iter().zip(&seen).map(|(&in_box, &seen)| in_box && seen).collect();
    let confidence = decidedness(&log_odds, &box_in_image);
    let failure = failure(&inside, &box_in_image, confidence, grid);
    if let (Some(failure), true) = (failure, fall_back) {
        return of_box(crop, failure);
    }
    // Moments of the grid's pixels: finer than the image's where the object is small.
    let on_grid = Mask { origin: [0, 0], width: grid as u32, height: grid as u32, inside };
    let window = crop.window();
    let ellipse = Moments::of_mask(&on_grid, PixelTerm::Centers)
        .and_then(|moments| moments.mapped(&crop.scale(), &Vector2::new(window.x0(), window.y0())).ellipse());
    match ellipse {
        Some(ellipse) => ViewSegmentation {
            mask: crop.mask_in_image(&on_grid.inside),
            ellipse,
            confidence,
            status: SegmentStatus::Ok,
        },
        None => of_box(crop, Failure::TooSmall),
    }
}

/// Mask and ellipse of the box.
fn of_box(crop: &Crop, failure: Failure) -> ViewSegmentation {
    let ellipse = Ellipse::inscribed_in(crop.bounding_box());
    let grid = crop.grid();
    let inside: Vec<bool> = (0..grid * grid)
        .map(|i| crop.to_image(&Vector2::new((i % grid) as f64 + 0.5, (i / grid) as f64 + 0.5)))
        .map(|place| (place - ellipse.center()).component_div(&(crop.bounding_box().size() * 0.5)).norm() <= 1.0)
        .collect();
    let (mask, status) = (crop.mask_in_image(&inside), SegmentStatus::Fallback(failure));
    ViewSegmentation { mask, ellipse, confidence: 0.0, status }
}

#[cfg(test)]
mod tests {
    use image::{Rgb, RgbImage};
    use quadlift::geometry::BoundingBox;

    use super::*;

    #[test]
    fn the_mask_of_a_box_holds_the_pixels_of_its_ellipse() {
        let image = RgbImage::from_pixel(320, 240, Rgb([90, 90, 90]));
        let bounding_box = BoundingBox::new([100.0, 60.0, 220.0, 110.0]).unwrap();
        let crop = Crop::cut(&image, &bounding_box, &CropOptions::default()).unwrap();
        let view = of_box(&crop, Failure::TooSmall);
        assert_eq!(view.ellipse, Ellipse::inscribed_in(&bounding_box));
        for (x, y) in (0..320).flat_map(|x| (0..240).map(move |y| (x, y))) {
            let radius = ((f64::from(x) + 0.5 - 160.0) / 60.0).hypot((f64::from(y) + 0.5 - 85.0) / 25.0);
            // At the border the grid of the crop decides.
            if (radius - 1.0).abs() > 0.06 {
                assert_eq!(view.mask.contains(x, y), radius < 1.0, "{x} {y}");
            }
        }
    }
}
