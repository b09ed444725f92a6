//! Neighboring frames: the order in which objects grow, and the frame pairs that births use.

use super::observations::Camera;
use crate::geometry::point_tree::PointTree;

/// Frames in which a birth searches for a partner of a box.
const PARTNERS: usize = 10;

/// Frames in which a birth is tested.
const WITNESSES: usize = 48;

/// Nearest frames among which partners and witnesses are chosen.
const NEIGHBORS: usize = 400;

/// Cosine of the maximum angle between the viewing directions of partners (101 degrees).
const MIN_COSINE: f64 = -0.2;

/// Frames with which the next one of the file is compared.
const COMPARED: usize = 64;

/// Fraction of frames whose next one must be their nearest for the file to count as a video.
const VIDEO_SHARE: f64 = 0.8;

/// Which frames are neighbors.
#[derive(Debug, Clone)]
pub(crate) struct FrameOrder {
    /// All frames, each near the one before.
    pub frames: Vec<u32>,
    /// Whether that is the order of the file.
    pub is_video: bool,
    /// For each frame, those whose boxes may start an object with one of its boxes, nearest first.
    pub partners: Vec<Vec<u32>>,
    /// For each frame, those in which such an object is tested.
    pub witnesses: Vec<Vec<u32>>,
}

impl FrameOrder {
    pub(crate) fn new(cameras: &[Camera], tree: &PointTree) -> Self {
        let unit = extent(cameras);
        let is_video = is_video(cameras, unit);
        let frames = if is_video { (0..cameras.len() as u32).collect() } else { chain(cameras, unit, 0) };
        let neighbors: Vec<(Vec<u32>, Vec<u32>)> =
            crate::parallel::map_indices(cameras.len(), |frame| neighbors(cameras, tree, frame));
        let (partners, witnesses) = neighbors.into_iter().unzip();
        Self { frames, is_video, partners, witnesses }
    }

    /// The order from a frame on: both directions of a video, otherwise always the nearest remaining frame.
    pub(crate) fn starting_at(&self, cameras: &[Camera], first: usize) -> Vec<u32> {
        if self.is_video {
            let count = cameras.len() as u32;
            return if first == 0 { (0..count).collect() } else { (0..count).rev().collect() };
        }
        chain(cameras, extent(cameras), first)
    }
}

/// The diagonal of the box around the cameras.
fn extent(cameras: &[Camera]) -> f64 {
    let Some(first) = cameras.first() else { return 1.0 };
    let (low, high) =
        cameras.iter().fold((first.center, first.center), |(low, high), c| (low.inf(&c.center), high.sup(&c.center)));
    (high - low).norm().max(1e-12)
}

/// How different two views are: distance over the extent, and direction.
fn difference(a: &Camera, b: &Camera, unit: f64) -> f64 {
    (a.center - b.center).norm() / unit + 0.5 * (1.0 - a.axis.dot(&b.axis))
}

/// Whether the next frame in the order is usually the nearest, for a sample of frames.
fn is_video(cameras: &[Camera], unit: f64) -> bool {
    let step = cameras.len().div_ceil(COMPARED).max(1);
    let is_nearest = |frame: usize| {
        let next = difference(&cameras[frame], &cameras[frame + 1], unit);
        (0..cameras.len())
            .step_by(step)
            .filter(|&other| other > frame)
            .all(|other| next <= difference(&cameras[frame], &cameras[other], unit) * (1.0 + 1e-6))
    };
    let steps = cameras.len().saturating_sub(1);
    let nearest = (0..steps).filter(|&frame| is_nearest(frame)).count();
    nearest as f64 >= VIDEO_SHARE * steps as f64
}

/// From `first` on always the nearest remaining frame.
fn chain(cameras: &[Camera], unit: f64, first: usize) -> Vec<u32> {
    let mut left: Vec<u32> = (0..cameras.len() as u32).filter(|&f| f as usize != first).collect();
    let mut order = Vec::with_capacity(cameras.len());
    if first < cameras.len() {
        order.push(first as u32);
    }
    while let Some(&last) = order.last() {
        let from = &cameras[last as usize];
        let next = left
            .iter()
            .enumerate()
            .map(|(place, &frame)| (difference(from, &cameras[frame as usize], unit), frame, place))
            .min_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        let Some((_, frame, place)) = next else { break };
        left.swap_remove(place);
        order.push(frame);
    }
    order
}

/// Partners and witnesses of a frame.
fn neighbors(cameras: &[Camera], tree: &PointTree, frame: usize) -> (Vec<u32>, Vec<u32>) {
    let from = &cameras[frame];
    let near: Vec<u32> = tree
        .nearest(&from.center, NEIGHBORS + 1)
        .into_iter()
        .filter(|&other| other as usize != frame && cameras[other as usize].axis.dot(&from.axis) > MIN_COSINE)
        .collect();
    let partners = geometric_ranks(near.len(), PARTNERS).into_iter().map(|rank| near[rank]).collect();
    let with_itself: Vec<u32> = std::iter::once(frame as u32).chain(near).collect();
    let ranks = if cameras.len() > NEIGHBORS {
        geometric_ranks(with_itself.len(), WITNESSES)
    } else {
        even_ranks(with_itself.len(), WITNESSES)
    };
    (partners, ranks.into_iter().map(|rank| with_itself[rank]).collect())
}

/// Up to `most` of `count` ranks, dense among the first and sparse among the last.
fn geometric_ranks(count: usize, most: usize) -> Vec<usize> {
    if count <= most {
        return (0..count).collect();
    }
    let at = |k: usize| (count as f64).powf(k as f64 / (most - 1) as f64).round() as usize - 1;
    let mut ranks: Vec<usize> = (0..most).map(at).collect();
    ranks.dedup();
    // Rounding makes some of the first ones equal: the gaps are filled evenly.
    for rank in even_ranks(count, 2 * most) {
        if ranks.len() == most {
            break;
        }
        if !ranks.contains(&rank) {
            ranks.push(rank);
        }
    }
    ranks.sort_unstable();
    ranks
}

/// Up to `most` of `count` ranks, evenly spread with the first and the last.
fn even_ranks(count: usize, most: usize) -> Vec<usize> {
    if count <= most {
        return (0..count).collect();
    }
    (0..most).map(|k| (k as f64 * (count - 1) as f64 / (most - 1) as f64).round() as usize).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Matrix3x4, Vector2, Vector3};

    fn camera(x: f64) -> Camera {
        Camera {
            matrix: Matrix3x4::identity(),
            center: Vector3::new(x, 0.0, 0.0),
            axis: Vector3::z(),
            focal: 1.0,
            size: Vector2::new(1.0, 1.0),
            boxes: 0..0,
        }
    }

    fn order(places: &[f64]) -> FrameOrder {
        let cameras: Vec<_> = places.iter().map(|&x| camera(x)).collect();
        FrameOrder::new(&cameras, &PointTree::new(cameras.iter().map(|c| c.center).collect()))
    }

    #[test]
    fn a_video_keeps_its_order_and_photos_are_chained() {
        // It stands still for a while.
        let video: Vec<f64> = (0..300).map(|i| f64::from(i.min(200))).collect();
        let found = order(&video);
        assert!(found.is_video && found.frames.is_sorted());
        let photos = order(&[0.0, 7.0, 2.0, 9.0, 4.0, 1.0, 8.0]);
        assert!(!photos.is_video);
        assert_eq!(photos.frames, [0, 5, 2, 4, 1, 6, 3]);
        assert_eq!(photos.partners[0], [5, 2, 4, 1, 6, 3]);
        assert!(order(&[]).frames.is_empty());
    }

    #[test]
    fn ranks_are_distinct_and_reach_from_first_to_last() {
        for (count, most) in [(5, 10), (11, 10), (500, 10), (401, 48), (49, 48)] {
            for ranks in [geometric_ranks(count, most), even_ranks(count, most)] {
                assert_eq!(ranks.len(), count.min(most), "{count} {most}");
                assert!(ranks.windows(2).all(|w| w[0] < w[1]));
                assert_eq!((ranks[0], *ranks.last().unwrap()), (0, count - 1));
            }
        }
    }
}
