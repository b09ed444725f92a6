//! Simulated tracker ids: tracks that break and swap their objects.

use std::collections::BTreeMap;

use nalgebra::Vector2;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;

use crate::sorting::StableSort;

/// A detection of a true object as the tracker meets it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Tracked {
    /// Index of the detection in the caller's list.
    pub detection: usize,
    /// Index of the frame.
    pub frame: usize,
    /// Index of the true object.
    pub object: usize,
    /// The middle of the box.
    pub place: Vector2<f64>,
}

/// Tracks of detections, frame by frame: at each with the probability `fragments` a new track begins, then with the
/// probability `switches` two neighbors exchange theirs. Returns the detection and the number of its track, for each.
pub(super) fn tracks(
    mut detections: Vec<Tracked>,
    fragments: f64,
    switches: f64,
    rng: &mut ChaCha8Rng,
) -> Vec<(usize, usize)> {
    detections.stable_sort_by_key(|d| (d.frame, d.object));
    let mut track_of: BTreeMap<usize, usize> = BTreeMap::new();
    let mut next = 0;
    let mut tracks = Vec::with_capacity(detections.len());
    for in_frame in detections.chunk_by(|a, b| a.frame == b.frame) {
        for d in in_frame {
            // Always drawn, so that the draws do not depend on what has happened.
            let breaks = rng.random_range(0.0..1.0f64) < fragments;
            if breaks || !track_of.contains_key(&d.object) {
                track_of.insert(d.object, next);
                next += 1;
            }
        }
        for d in in_frame {
            let others = in_frame.iter().filter(|other| other.object != d.object);
            let distance = |other: &Tracked| (other.place - d.place).norm();
            let nearest = others.min_by(|a, b| distance(a).total_cmp(&distance(b)));
            if rng.random_range(0.0..1.0f64) < switches
                && let Some(nearest) = nearest
            {
                let (own, other) = (track_of[&d.object], track_of[&nearest.object]);
                track_of.insert(d.object, other);
                track_of.insert(nearest.object, own);
            }
        }
        tracks.extend(in_frame.iter().map(|d| (d.detection, track_of[&d.object])));
    }
    tracks
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random;

    fn detections() -> Vec<Tracked> {
        let of_object = |object: usize| {
            (0..200).map(move |frame| Tracked {
                detection: 200 * object + frame,
                frame,
                object,
                place: Vector2::new(10.0 * object as f64, 0.0),
            })
        };
        (0..3).flat_map(of_object).collect()
    }

    #[test]
    fn a_perfect_tracker_keeps_identities() {
        let tracks = tracks(detections(), 0.0, 0.0, &mut random::stream(1, 0));
        assert!(tracks.iter().all(|&(detection, track)| detection / 200 == track) && tracks.len() == 600);
    }

    #[test]
    fn tracks_break_and_swap_as_often_as_asked() {
        let broken = tracks(detections(), 0.1, 0.0, &mut random::stream(2, 0));
        let count = broken.iter().map(|&(_, track)| track).max().unwrap() + 1;
        // 600 chances of 0.1: 60 with a standard deviation of 7.3.
        assert!(count.abs_diff(63) < 30, "{count}");
        let swapped = tracks(detections(), 0.0, 0.05, &mut random::stream(3, 0));
        assert!(swapped.iter().all(|&(_, track)| track < 3));
        let wrong = swapped.iter().filter(|&&(detection, track)| detection / 200 != track).count();
        assert!(wrong > 100, "{wrong}");
        // In a frame every track is there once.
        for frame in 0..200 {
            let mut here: Vec<usize> = swapped.iter().filter(|(d, _)| d % 200 == frame).map(|&(_, t)| t).collect();
            here.sort_unstable();
            assert_eq!(here, [0, 1, 2]);
        }
    }
}
