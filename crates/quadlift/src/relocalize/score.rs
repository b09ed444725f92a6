//! Which boxes a pose explains, and how well.

use std::f64::consts::{PI, TAU};

use super::LocatedPose;
use super::prepared::PreparedQuery;
use super::refine::{Match, Predicted, covariance, edge_residuals, known_cost, refine};
use crate::geometry::linalg::invert_spd;
use crate::geometry::rigid::Pose;
use crate::optimize::matching::{Pair, best_pairs};
use crate::optimize::student_t::StudentT;

/// Probability that an object that should be seen is detected: low, because walls and other things hide objects of large maps.
const SEEN: f64 = 0.6;

/// Objects whose boxes would be smaller than this share of the smallest box are not expected.
const EXPECTED_SIZE: f64 = 0.8;

/// Logarithm of Student's t density with 9 degrees of freedom at zero.
const LOG_PEAK: f64 = -0.946_66;

/// Rounds of matching and refining, and steps of each.
const ROUNDS: usize = 50;
const STEPS: usize = 12;

/// The predictions of all landmarks at a pose.
pub(super) fn predictions(query: &PreparedQuery, pose: &Pose) -> Vec<Option<Predicted>> {
    (0..query.map.landmarks().len()).map(|k| Predicted::of_landmark(query, pose, k)).collect()
}

/// Logarithm of the odds that a box shows a landmark, against a false box; `widen` multiplies standard deviations.
pub(super) fn gain(query: &PreparedQuery, predicted: &Predicted, of: &Match, widen: f64) -> f64 {
    SEEN.ln() + edge_gains(query, predicted, of, widen).sum::<f64>()
}

/// The gains of the edges that say something.
fn edge_gains<'a>(
    query: &'a PreparedQuery,
    predicted: &Predicted,
    of: &Match,
    widen: f64,
) -> impl Iterator<Item = f64> + 'a {
    let student_t = StudentT::new(super::refine::DOF);
    let clutter = query.boxes[of.query_box].log_clutter / 4.0;
    edge_residuals(query, predicted, of).into_iter().flatten().map(move |edge| {
        let residual = edge.residual / widen;
        LOG_PEAK - 0.5 * student_t.cost_of_one(residual * residual) - (edge.sd * widen).ln() - clutter
    })
}

/// The largest gain, whichever edges are hidden.
fn most_gain(query: &PreparedQuery, predicted: &Predicted, of: &Match) -> f64 {
    let all_hidden = Match { one_sided: [true; 4], ..*of };
    let least = edge_gains(query, predicted, &all_hidden, 1.0).sum::<f64>();
    let best = edge_gains(query, predicted, of, 1.0).filter(|gain| *gain > 0.0).sum::<f64>();
    SEEN.ln() + least.min(0.0) + best
}

/// Whether a box is so near to a predicted one that they may show the same object.
fn is_near(query: &PreparedQuery, query_box: usize, predicted: &Predicted) -> bool {
    let (a, b) = (&query.boxes[query_box].edges, &predicted.edges);
    a[0] < b[2] && b[0] < a[2] && a[1] < b[3] && b[1] < a[3]
}

/// Which edges of a landmark a nearer one hides: those that the outline touches inside of the other's outline.
fn occluded_edges(predicted: &[Option<Predicted>], of: &Predicted) -> [bool; 4] {
    std::array::from_fn(|edge| {
        let at = of.touches(edge);
        predicted.iter().flatten().any(|other| other.depth() < of.depth() && other.covers(&at))
    })
}

/// The boxes that a pose explains with the landmarks that they show, and the sum of their gains.
fn matches(query: &PreparedQuery, predicted: &[Option<Predicted>]) -> (Vec<Match>, f64) {
    let mut possible = Vec::new();
    let mut pairs = Vec::new();
    for (index, alike) in query.alike.iter().enumerate() {
        for &landmark in alike {
            let Some(prediction) = predicted[landmark].as_ref().filter(|p| is_near(query, index, p)) else { continue };
            let mut of = Match::new(query, index, landmark);
            // Whichever edges are hidden: that takes long to find out.
            if most_gain(query, prediction, &of) <= 0.0 {
                continue;
            }
            let hidden = occluded_edges(predicted, prediction);
            of.one_sided.iter_mut().zip(hidden).for_each(|(one_sided, hidden)| *one_sided |= hidden);
            let gain = gain(query, prediction, &of, 1.0);
            if gain > 0.0 {
                pairs.push(Pair { row: index as u32, column: landmark as u32, gain });
                possible.push(of);
            }
        }
    }
    let chosen = best_pairs(&pairs);
    let sum = chosen.iter().map(|&k| pairs[k].gain).sum();
    (chosen.iter().map(|&k| possible[k]).collect(), sum)
}

/// Logarithm of the probability that the landmarks that a pose should show, and that have no box, are missed.
fn log_missed(query: &PreparedQuery, matches: &[Match], predicted: &[Option<Predicted>]) -> f64 {
    let Some(image) = query.image else { return 0.0 };
    let mut missed = 0usize;
    for (landmark, prediction) in predicted.iter().enumerate() {
        let Some(p) = prediction else { continue };
        let [x0, y0, x1, y1] = p.edges;
        let (x, y) = (0.5 * (x0 + x1), 0.5 * (y0 + y1));
        let in_image = x > image[0] && x < image[2] && y > image[1] && y < image[3];
        let large = 0.25 * (x1 - x0) * (y1 - y0) > (EXPECTED_SIZE * query.smallest).powi(2);
        if !in_image || !large || matches.iter().any(|of| of.landmark == landmark) {
            continue;
        }
        let hides = |other: &Predicted| {
            let [a, b, c, d] = other.edges;
            other.depth() < p.depth() && x > a && x < c && y > b && y < d
        };
        missed += usize::from(!predicted.iter().flatten().any(hides));
    }
    missed as f64 * (1.0 - SEEN).ln()
}

/// The pose near a start that explains most, with its evidence; `None` where it explains nothing.
pub(super) fn located(query: &PreparedQuery, start: Pose) -> Option<LocatedPose> {
    let mut pose = start;
    let mut before = Vec::new();
    let mut refined = None;
    for _ in 0..ROUNDS {
        let (matches, _) = matches(query, &predictions(query, &pose));
        if matches.is_empty() {
            return None;
        }
        if matches == before {
            break;
        }
        let better = refine(query, pose, &matches, STEPS)?;
        pose = better.pose;
        before = matches;
        refined = Some(better);
    }
    let information = refined?.information;
    let predicted = predictions(query, &pose);
    let (matches, gains) = matches(query, &predicted);
    // What the matches leave open, up to rounding errors, is no pose.
    invert_spd(&information)?;
    let cholesky = information.cholesky()?;
    let log_determinant = 2.0 * cholesky.l().diagonal().iter().map(|x| x.ln()).sum::<f64>();
    let mut evidence = gains + log_missed(query, &matches, &predicted);
    // Laplace's approximation: the share of all poses that this one takes.
    evidence += 3.0 * TAU.ln() - 0.5 * log_determinant - log_volume(query);
    evidence -= 0.5 * known_cost(query, &pose);
    if let Some(gravity) = &query.gravity {
        // Against a direction that is anywhere on the sphere.
        evidence += (4.0 * PI / (TAU * gravity.sd * gravity.sd)).ln();
    }
    if let Some(known) = &query.height {
        // Against a height that is anywhere in the range of positions.
        evidence += log_range(query) - (TAU.sqrt() * known.sd).ln();
    }
    let covariance = covariance(query, &pose, &matches, &information)?;
    evidence.is_finite().then_some(()).and_then(|()| pose.checked()).map(|cam_from_world| LocatedPose {
        cam_from_world,
        covariance,
        matches: matches.iter().map(|of| (of.query_box, of.landmark)).collect(),
        evidence,
    })
}

/// Logarithm of the volume of all poses: rotations, and positions about as far from the map as its objects are seen.
fn log_volume(query: &PreparedQuery) -> f64 {
    (8.0 * PI * PI).ln() + 3.0 * log_range(query)
}

/// Logarithm of the range of positions along each axis.
fn log_range(query: &PreparedQuery) -> f64 {
    let farthest = query.candidates.iter().map(|candidate| candidate.depths[1]).fold(0.0, f64::max);
    (query.map.extent() + 2.0 * farthest).ln()
}

#[cfg(test)]
mod tests {
    use super::super::{Landmark, LandmarkMap, LocateOptions, Query, QueryBox};
    use super::*;
    use crate::geometry::{BoundingBox, Ellipsoid, Intrinsics, Projection, project_bounding_box};
    use nalgebra::{Matrix3, Point3, Rotation3, Vector3};

    /// A camera at the origin that looks along z.
    fn pose() -> Pose {
        Pose { rotation: Matrix3::identity(), translation: Vector3::zeros() }
    }

    fn ball(x: f64, y: f64, z: f64, radius: f64) -> Landmark {
        let center = Point3::new(x, y, z);
        let ellipsoid = Ellipsoid { center, semi_axes: Vector3::repeat(radius), rotation: Rotation3::identity() };
        Landmark { body: ellipsoid.into(), covariance: None, category: None, correction: None }
    }

    /// The box of a ball, with edges that are off by some pixels.
    fn seen(ball: &Landmark, off: [f64; 4]) -> QueryBox {
        let intrinsics = Intrinsics::new(1000.0, 1000.0, 640.0, 360.0).unwrap();
        let projection = Projection::from_camera(&intrinsics, &pose().checked().unwrap());
        let exact = project_bounding_box(&projection, &ball.body).unwrap().edges();
        let bounding_box = BoundingBox::new(std::array::from_fn(|k| exact[k] + off[k])).unwrap();
        QueryBox { bounding_box, box_in_image: None, category: None }
    }

    fn query(boxes: Vec<QueryBox>) -> Query {
        let intrinsics = Intrinsics::new(1000.0, 1000.0, 640.0, 360.0).unwrap();
        Query { intrinsics, image_size: Some([1280.0, 720.0].into()), boxes }
    }

    /// Against the densities of four edges of an object, and of a false box: anywhere in the image, its width and its height
    /// within a factor of `exp 4`.
    #[test]
    fn a_box_is_of_an_object_with_the_odds_of_its_edges() {
        let off = [6.0, -4.0, 9.0, 3.0];
        let balls = vec![ball(0.2, 0.1, 5.0, 0.5)];
        let query = query(vec![seen(&balls[0], off)]);
        let map = LandmarkMap::new(balls);
        let options = LocateOptions::default();
        let prepared = PreparedQuery::new(&map, &query, &options);
        let predicted = predictions(&prepared, &pose())[0].unwrap();
        let [x0, y0, x1, y1] = query.boxes[0].bounding_box.edges();
        let half_size = 0.25 * (x1 - x0 + y1 - y0);
        // Lengths are those of the image at depth one.
        let sd = (options.edge_noise * half_size).hypot(1.0) / 1000.0;
        let false_box: f64 = 1.28 * 0.72 * ((x1 - x0) / 1000.0) * ((y1 - y0) / 1000.0) * 16.0;
        // Student's t distribution with 9 degrees of freedom; Gamma(5) and Gamma(4.5).
        let peak = 24.0 / 11.631_728_396_567_448 / (9.0 * PI).sqrt();
        for widen in [1.0, 3.0] {
            let density = |off: f64| {
                let residual = off / 1000.0 / (widen * sd);
                peak * (1.0 + residual * residual / 9.0).powi(-5) / (widen * sd)
            };
            let expected = (0.6 * off.map(density).iter().product::<f64>() * false_box).ln();
            let found = gain(&prepared, &predicted, &Match::new(&prepared, 0, 0), widen);
            assert!((found - expected).abs() < 1e-4, "{widen}: {found} {expected}");
        }
    }

    #[test]
    fn objects_that_should_be_seen_and_are_not_count_against_a_pose() {
        let detected = ball(-1.0, 0.0, 5.0, 0.4);
        let missed = ball(1.0, 0.0, 5.0, 0.4);
        // Behind the detected one, outside of the image, smaller than what is detected, behind the camera.
        let unexpected = [
            ball(-2.0, 0.0, 10.0, 0.5),
            ball(9.0, 0.0, 10.0, 1.0),
            ball(0.0, 1.0, 10.0, 0.3),
            ball(0.0, 0.0, -5.0, 0.4),
        ];
        let boxes = query(vec![seen(&detected, [0.0; 4])]);
        let log_missed_of = |more: &[Landmark], query: &Query| {
            let mut balls = vec![detected.clone()];
            balls.extend_from_slice(more);
            let map = LandmarkMap::new(balls);
            let prepared = PreparedQuery::new(&map, query, &LocateOptions::default());
            let predicted = predictions(&prepared, &pose());
            log_missed(&prepared, &[Match::new(&prepared, 0, 0)], &predicted)
        };
        assert_eq!(log_missed_of(&unexpected, &boxes), 0.0);
        // Four in ten that should be seen are not.
        for count in 1..3 {
            let more = vec![missed.clone(); count];
            let found = log_missed_of(&[&more[..], &unexpected[..]].concat(), &boxes);
            assert!((found - count as f64 * f64::ln(0.4)).abs() < 1e-12, "{count}: {found}");
        }
        let anywhere = Query { image_size: None, ..boxes };
        assert_eq!(log_missed_of(std::slice::from_ref(&missed), &anywhere), 0.0);
    }
}
