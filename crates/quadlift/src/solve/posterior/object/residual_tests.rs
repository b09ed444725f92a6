//! What residuals are, against calculations in the image; and the evidence of noise levels.

use nalgebra::{Matrix3x4, Point3, Rotation3, Vector2, Vector3};

use super::objective::Objective;
use super::prior::ObjectPrior;
use crate::body_model::BodyModel;
use crate::body_model::ellipsoid::EllipsoidModel;
use crate::geometry::{
    BoundingBox, CamFromWorld, Ellipse, Ellipsoid, Intrinsics, Projection, TangentLines, project_ellipsoid,
};
use crate::scene::View;
use crate::solve::conditioning::ObjectFrame;
use crate::solve::noise_model::NoiseModel;
use crate::solve::posterior::noise::groups::NoiseGroup;
use crate::solve::posterior::noise::levels::NoiseLevels;
use crate::solve::posterior::residuals::measurements::Measurements;
use crate::solve::posterior::residuals::row::ResidualRow;
use crate::solve::posterior::residuals::view_rows::view_rows;

const UNIT: f64 = 0.8;

fn frame() -> ObjectFrame {
    ObjectFrame {
        origin: Point3::new(0.1, 0.2, -0.1),
        unit: UNIT,
        axes: *Rotation3::from_euler_angles(0.5, -0.2, 0.9).matrix(),
    }
}

fn projection() -> Projection {
    let r = Rotation3::from_euler_angles(1.3, 0.7, 0.2);
    let mut pose = Matrix3x4::zeros();
    pose.fixed_columns_mut::<3>(0).copy_from(r.matrix());
    pose.set_column(3, &Vector3::new(0.3, -0.2, 9.0));
    let intrinsics = Intrinsics::new(700.0, 720.0, 320.0, 240.0).unwrap();
    Projection::from_camera(&intrinsics, &CamFromWorld::new(pose).unwrap())
}

fn body() -> EllipsoidModel {
    let axes = *Rotation3::from_euler_angles(0.4, -0.8, 1.1).matrix();
    EllipsoidModel::from_axes(Vector3::new(0.1, -0.05, 0.2), axes, Vector3::new(1.6, 1.0, 0.6))
}

/// The body's outline in the image, by its dual conic.
fn outline() -> Ellipse {
    let body = body();
    let world = Ellipsoid {
        center: frame().point_in_world(body.center()),
        semi_axes: body.semi_axes() * UNIT,
        rotation: Rotation3::from_matrix_unchecked(frame().axes * body.axes()),
    };
    project_ellipsoid(&projection(), &world).unwrap()
}

fn view(bounding_box: Option<BoundingBox>, ellipse: Option<Ellipse>) -> View {
    View {
        frame_index: 0,
        projection: projection(),
        image_size: None,
        bounding_box,
        ellipse,
        tangent_lines: None,
        partial: false,
        box_in_image: None,
        occluded_edges: [false; 4],
        cut_off: [false; 4],
        cues: Default::default(),
        depth_scale: crate::scene::DepthScale::Source,
        depth_shift: 0.0,
    }
}

/// A level of its own for each group.
fn noise() -> NoiseLevels {
    let levels = [
        ("ellipse_center", 0.11),
        ("ellipse_size", 0.13),
        ("ellipse_aspect", 0.17),
        ("ellipse_angle", 0.19),
        ("shape", 0.23),
        ("partial_ellipse", 0.29),
        ("edge_noise", 0.05),
        ("occluded_edge_noise", 0.15),
    ];
    NoiseLevels::given(&NoiseModel::new(levels).unwrap(), 67.0)
}

fn rows(view: &View, noise: &NoiseLevels, smooth: bool) -> Vec<ResidualRow> {
    let measurements = Measurements::new(frame(), &[*view], false, false);
    let mut rows = Vec::new();
    view_rows(&measurements, 0, &body(), noise, smooth, &mut rows);
    rows
}

fn assert_residuals(rows: &[ResidualRow], expected: &[(f64, NoiseGroup)]) {
    assert_eq!(rows.len(), expected.len());
    for (row, (residual, group)) in rows.iter().zip(expected) {
        assert_eq!((row.group, row.counts), (*group, true));
        let expected = residual / noise().of(*group);
        assert!((row.residual - expected).abs() < 1e-9 * (1.0 + expected.abs()), "{group:?}: {row:?} {expected}");
    }
}

/// Observed ellipses: wider and higher than they are high and wide, turned from the body's outline by up to a right
/// angle either way.
fn observed() -> Vec<Ellipse> {
    let outline = outline();
    let turns = [-1.2, -0.3, 0.05, 0.8, 1.5];
    turns
        .iter()
        .flat_map(|turn| [[90.0, 50.0], [60.0, 80.0]].map(|axes| (turn, axes)))
        .map(|(turn, axes)| Ellipse::new(outline.center + Vector2::new(7.0, -4.0), axes.into(), outline.angle + turn))
        .collect::<Result<_, _>>()
        .unwrap()
}

/// Logarithm of the longer over the shorter semi-axis, halved, and the angle of the longer one.
fn aspect_and_angle(ellipse: &Ellipse) -> (f64, f64) {
    let [a, b]: [f64; 2] = ellipse.semi_axes.into();
    let right_angle = std::f64::consts::FRAC_PI_2;
    (0.5 * (a / b).ln().abs(), if a >= b { ellipse.angle } else { ellipse.angle + right_angle })
}

#[test]
fn an_ellipse_is_compared_by_center_size_aspect_and_angle() {
    let outline = outline();
    for ellipse in observed() {
        let ((seen_aspect, seen_angle), (aspect, angle)) = (aspect_and_angle(&ellipse), aspect_and_angle(&outline));
        // Along the longer axis of the observed ellipse, in its mean semi-axes.
        let turn = nalgebra::Rotation2::new(-seen_angle);
        let center = turn * (outline.center - ellipse.center) / ellipse.semi_axes.mean();
        let size = 0.5 * (outline.semi_axes.product() / ellipse.semi_axes.product()).ln();
        let off = angle - seen_angle;
        // Axes have no sign: a sine of the same sign as that of twice the angle.
        let sine = off.sin().abs().copysign((2.0 * off).sin());
        let place = [
            (center.x, NoiseGroup::EllipseCenter),
            (center.y, NoiseGroup::EllipseCenter),
            (size, NoiseGroup::EllipseSize),
        ];
        let shape = [(aspect - seen_aspect, NoiseGroup::EllipseAspect), (aspect * sine, NoiseGroup::EllipseAngle)];
        assert_residuals(&rows(&view(None, Some(ellipse)), &noise(), false), &[&place[..], &shape].concat());
        let (sin, cos) = (2.0 * off).sin_cos();
        let smooth =
            [(aspect * cos - seen_aspect, NoiseGroup::EllipseAspect), (aspect * sin, NoiseGroup::EllipseAngle)];
        assert_residuals(&rows(&view(None, Some(ellipse)), &noise(), true), &[&place[..], &smooth].concat());
    }
}

#[test]
fn beside_a_box_an_ellipse_tells_its_shape_only() {
    let around = BoundingBox::new([250.0, 160.0, 420.0, 300.0]).unwrap();
    for ellipse in observed() {
        let ((seen_aspect, seen_angle), (aspect, angle)) = (aspect_and_angle(&ellipse), aspect_and_angle(&outline()));
        let (sin, cos) = (2.0 * (angle - seen_angle)).sin_cos();
        let shape = [(aspect * cos - seen_aspect, NoiseGroup::Shape), (aspect * sin, NoiseGroup::Shape)];
        for smooth in [false, true] {
            let all = rows(&view(Some(around), Some(ellipse)), &noise(), smooth);
            assert_residuals(&all[..2], &shape);
            assert!(all.len() == 6 && all[2..].iter().all(|row| row.group == NoiseGroup::Edge));
        }
        // Of a part of the object: all of it has a level of its own.
        let part = View { partial: true, ..view(Some(around), Some(ellipse)) };
        assert_residuals(&rows(&part, &noise(), false)[..2], &shape.map(|(x, _)| (x, NoiseGroup::PartialEllipse)));
        let part = View { partial: true, ..view(None, Some(ellipse)) };
        assert!(rows(&part, &noise(), false).iter().all(|row| row.group == NoiseGroup::PartialEllipse));
    }
}

#[test]
fn edges_err_by_a_part_in_pixels_and_a_part_of_the_size() {
    let relative = 0.05;
    for (pixels, half_size) in [(0.0, 40.0), (2.0, 4.0), (2.0, 40.0), (2.0, 400.0), (8.0, 40.0)] {
        let noise_model = NoiseModel::new([("edge_noise", relative), ("edge_noise_px", pixels)]).unwrap();
        let noise = NoiseLevels::given(&noise_model, 67.0);
        let deviation = noise.of(NoiseGroup::Edge) * noise.size_factor(half_size) * half_size;
        let expected = pixels.hypot(relative * half_size);
        assert!((deviation / expected - 1.0).abs() < 1e-12, "{pixels} {half_size}: {deviation} {expected}");
    }
}

#[test]
fn residuals_of_edges_are_pixels_over_the_deviation_of_the_box() {
    let exact = outline().bounding_box().edges();
    let noise = NoiseLevels::given(&NoiseModel::new([("edge_noise", 0.05), ("edge_noise_px", 3.0)]).unwrap(), 67.0);
    for edge in 0..4 {
        let mut edges = exact;
        // Outwards: the body is inside of the plane.
        edges[edge] += if edge < 2 { -0.01 } else { 0.01 };
        let measured = BoundingBox::new(edges).unwrap();
        let found: Vec<f64> = rows(&view(Some(measured), None), &noise, false).iter().map(|row| row.residual).collect();
        let expected = 0.01 / 3.0f64.hypot(0.05 * measured.mean_half_size());
        // Left, right, top, bottom.
        let place = [0, 2, 1, 3][edge];
        // Seen from the side, edges are nearer or farther than the center, at whose depth planes are measured.
        assert!((found[place] / expected - 1.0).abs() < 0.08, "{edge}: {found:?} {expected}");
        assert!((0..4).all(|k| k == place || found[k].abs() < 1e-2 * expected), "{edge}: {found:?} {expected}");
    }
}

#[test]
fn lines_of_a_mask_that_are_cut_off_or_hidden_are_one_sided() {
    let mut lines = TangentLines::of_ellipse(&outline());
    (lines.cut_off[5], lines.hidden[2]) = (true, true);
    let open = [2, 5];
    let seen = View { tangent_lines: Some(lines), ..view(lines.bounding_box(), None) };
    let measurements = Measurements::new(frame(), &[seen], false, false);
    // Opposite lines follow each other: 0 and 4, 1 and 5, 2 and 6, 3 and 7.
    let one_sided: Vec<bool> = measurements.edges.iter().map(|edge| edge.one_sided).collect();
    assert_eq!(one_sided, [false, false, false, true, true, false, false, false]);
    assert!(measurements.edges.iter().all(|edge| edge.group == NoiseGroup::Edge));
    // The body that they are of touches all of them.
    assert!(rows(&seen, &noise(), false).iter().all(|row| row.residual.abs() < 1e-6));
    // A body that reaches beyond a line that is cut off agrees with it, and one that does not reach it does not.
    let moved = |k: usize, by: f64| {
        let mut lines = lines;
        lines.reach[k] += by;
        rows(&View { tangent_lines: Some(lines), ..seen }, &noise(), false)[[0, 2, 4, 6, 1, 3, 5, 7][k]]
    };
    for k in 0..8 {
        let (less, more) = (moved(k, -5.0), moved(k, 5.0));
        assert_eq!((less.residual < -0.1, less.counts), (!open.contains(&k), !open.contains(&k)), "{k}: {less:?}");
        let half_size = lines.bounding_box().unwrap().mean_half_size();
        let expected = 5.0 / (half_size * noise().of(more.group) * noise().size_factor(half_size));
        assert!((more.residual / expected - 1.0).abs() < 0.1 && more.counts, "{k}: {more:?} {expected}");
    }
}

/// Evidence for noise levels, less that for others that are `factor` times as large, at the same body and without priors:
/// the determinant of the nine parameters' covariance grows by `factor^18`, the squares fall by `factor^2`.
#[test]
fn evidence_weighs_the_squares_the_number_of_residuals_and_what_they_determine() {
    let turned = |azimuth: f64| {
        let turn = Rotation3::from_axis_angle(&Vector3::z_axis(), azimuth);
        projection().with_moved_camera(&turn, &Vector3::new(3.0 * azimuth, 1.0 - azimuth, 0.4)).unwrap()
    };
    let mut views: Vec<View> = [-0.8, -0.4, 0.1, 0.5, 0.9]
        .map(|azimuth| View {
            projection: turned(azimuth),
            ..view(BoundingBox::new([250.0, 160.0, 420.0, 300.0]).ok(), None)
        })
        .into();
    // Far inside of the body, and cut off: it does not count.
    views[2].bounding_box = BoundingBox::new([330.0, 160.0, 420.0, 300.0]).ok();
    views[2].cut_off[0] = true;
    let measurements = Measurements::new(frame(), &views, false, false);
    let prior = ObjectPrior::default();
    let of = |noise: &NoiseLevels| {
        let objective = Objective {
            measurements: &measurements,
            prior: &prior,
            ground: None,
            noise,
            heavy_tails: false,
            outlier_scale: None,
            smooth: false,
        };
        let equations = objective.linearize(&body()).unwrap();
        let mut counted = 0;
        objective.each_row(&body(), |_, row, _| counted += usize::from(row.counts));
        (objective.evidence(&body(), &equations).unwrap(), equations.cost, counted)
    };
    let (evidence, cost, counted) = of(&noise());
    assert!((10..20).contains(&counted), "{counted}");
    for factor in [0.5, 1.1, 3.0] {
        let expected = (9.0 - counted as f64) * f64::ln(factor) + 0.5 * cost * (1.0 - 1.0 / (factor * factor));
        let found = of(&noise().scaled(factor)).0 - evidence;
        assert!((found - expected).abs() < 1e-6 * (1.0 + cost), "{factor}: {found} {expected}");
    }
}
