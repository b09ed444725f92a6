//! The options of a run that a user can choose.

use quadlift::MeasurementKind;
use quadlift::association::IdPolicy;
use quadlift::cross_validation::Extent;
use quadlift::geometry::BodyKind;
use quadlift::run::{AssociateWhen, RunOptions};
use quadlift::solve::{Method, NoiseModel, PoseMotion, PoseNoise, PosteriorOptions};

use super::Command::{Associate, Localize, Node, Python, Segment, Stream};
use super::{Command, Group, Kind, Range, Spec, Value};

const LOCALIZE: &[Command] = &[Localize, Python];
const MAPS: &[Command] = &[Localize, Python, Stream, Node];
const OF_POSTERIOR: Option<(&str, &str)> = Some(("method", "posterior"));

/// Kinds of bodies to fit.
const BODIES: [&str; 5] = ["auto", "ellipsoid", "cuboid", "cylinder", "rounded"];

/// A row with what most have.
const ROW: Spec<RunOptions> = Spec { group: Group::Model, of: LOCALIZE, ..Spec::ROW };

/// The options of a run, in the order in which they are set and shown: the method comes before its options.
pub const RUN: &[Spec<RunOptions>] = &[
    Spec {
        name: "method",
        kind: Kind::Choice(&Method::NAMES),
        placeholder: "METHOD",
        short: "Choose the estimator to use",
        help: "Estimator: posterior (refinement, the best), planes, lfd and pfd (closed forms), reg (the regularized one)",
        group: Group::Research,
        whole_scene: false,
        get: |o| o.localize.method.name().into(),
        set: |o, value| {
            o.localize.method = value.named()?;
            Ok(())
        },
        ..ROW
    },
    Spec {
        name: "reg_weight",
        kind: Kind::Number(Range::NotNegative),
        placeholder: "WEIGHT",
        short: "Set the weight of the regularizer",
        help: "Weight of the regularizer [default: 1e16]",
        group: Group::Research,
        only: Some(("method", "reg")),
        whole_scene: false,
        get: |o| if let Method::Reg(reg) = &o.localize.method { reg.lambda.into() } else { Value::Unset },
        set: |o, value| {
            if let (Method::Reg(reg), Some(weight)) = (&mut o.localize.method, value.number()) {
                reg.lambda = weight;
            }
            Ok(())
        },
        ..ROW
    },
    Spec {
        name: "body",
        kind: Kind::Choice(&BODIES),
        placeholder: "BODY",
        short: "Choose the kind of body to fit",
        help: "Kind of body to fit: ellipsoid, cuboid, cylinder, rounded (between cuboid and ellipsoid), or auto: selected for each \
               object, an ellipsoid without evidence for another kind",
        group: Group::Model,
        of: MAPS,
        only: OF_POSTERIOR,
        whole_scene: false,
        get: |o| of_posterior(o, |of| of.body.map_or("auto", BodyKind::name).to_owned()),
        set: |o, value| {
            let body = BodyKind::FITTED.into_iter().find(|kind| value.text() == Some(kind.name()));
            set_posterior(o, |of| of.body = body)
        },
        ..ROW
    },
    Spec {
        name: "source",
        kind: Kind::Text,
        placeholder: "SOURCE",
        short: "Use only the detections of this source",
        help: "Use only the detections of this source; required if the scene has several",
        group: Group::Input,
        get: |o| o.localize.source.as_deref().into(),
        set: |o, value| {
            o.localize.source = value.text().map(str::to_owned);
            Ok(())
        },
        ..ROW
    },
    Spec {
        name: "measurement",
        kind: Kind::Choice(&MeasurementKind::NAMES),
        placeholder: "KIND",
        short: "Choose the measurements to use",
        help: "Measurements to use: auto (what a detection has; if both, the box for position and size, the ellipse for shape), \
               box, ellipse, box+ellipse, or mask (its outline, with posterior and planes; also outlines and oriented boxes). Detections \
               without the selected measurement are skipped",
        group: Group::Input,
        get: |o| o.localize.measurements.name().into(),
        set: |o, value| {
            o.localize.measurements = value.named()?;
            Ok(())
        },
        ..ROW
    },
    Spec {
        name: "associate",
        kind: Kind::Choice(&AssociateWhen::NAMES),
        placeholder: "auto|never|always",
        short: "Choose when detections are associated",
        help: "Associate detections that show the same object first: auto (if any lack an id), never or always",
        group: Group::Association,
        get: |o| o.associate.name().into(),
        set: |o, value| {
            o.associate = value.named()?;
            Ok(())
        },
        ..ROW
    },
    Spec {
        name: "ids",
        kind: Kind::Choice(&IdPolicy::NAMES),
        placeholder: "trust|evidence|ignore",
        short: "Choose how far to trust existing ids",
        help: "How far to trust existing ids: trust, evidence or ignore [default: trust; evidence if all detections are associated]",
        group: Group::Association,
        get: |o| o.ids.map(IdPolicy::name).into(),
        set: |o, value| {
            o.ids = value.text().map(|_| value.named()).transpose()?;
            Ok(())
        },
        ..ROW
    },
    Spec {
        name: "min_views",
        kind: Kind::Whole(0),
        placeholder: "N",
        short: "Skip objects with fewer views",
        help: "Skip objects with fewer views; planes, lfd and pfd need three",
        group: Group::Input,
        whole_scene: false,
        get: |o| o.localize.min_views.max(o.localize.method.min_views()).into(),
        set: |o, value| {
            o.localize.min_views = value.count()?;
            Ok(())
        },
        ..ROW
    },
    Spec {
        name: "max_occluded",
        kind: Kind::Number(Range::Finite),
        placeholder: "LEVEL",
        short: "Skip detections that are more occluded",
        help: "Skip detections that are more occluded (KITTI: 0 visible, 1 partly, 2 largely, 3 unknown)",
        group: Group::Input,
        get: |o| o.localize.max_occluded.into(),
        set: |o, value| {
            o.localize.max_occluded = value.number();
            Ok(())
        },
        ..ROW
    },
    Spec {
        name: "max_truncated",
        kind: Kind::Number(Range::Finite),
        placeholder: "LEVEL",
        short: "Skip detections that are more truncated",
        help: "Skip detections that are more truncated (KITTI: 0 entirely inside the image)",
        group: Group::Input,
        get: |o| o.localize.max_truncated.into(),
        set: |o, value| {
            o.localize.max_truncated = value.number();
            Ok(())
        },
        ..ROW
    },
    Spec {
        name: "learn_sizes",
        short: "Learn the sizes of categories",
        help: "Learn the size of each category from its other objects; sizes of priors win",
        group: Group::Model,
        only: OF_POSTERIOR,
        get: |o| of_posterior(o, |of| of.learn_sizes),
        set: |o, value| {
            let flag = flag(&value)?;
            set_posterior(o, |of| of.learn_sizes = flag)
        },
        ..ROW
    },
    Spec {
        name: "upright",
        short: "Do not detect which objects stand upright",
        help: "Detect which objects stand upright (with an axis along the scene's `up`)",
        group: Group::Model,
        of: MAPS,
        only: OF_POSTERIOR,
        get: |o| of_posterior(o, |of| of.upright),
        set: |o, value| {
            let flag = flag(&value)?;
            set_posterior(o, |of| of.upright = flag)
        },
        ..ROW
    },
    Spec {
        name: "ground_plane",
        short: "Place all objects on one ground plane",
        help: "All objects stand on a common ground plane, which is estimated (the scene needs `up`)",
        group: Group::Model,
        only: OF_POSTERIOR,
        get: |o| of_posterior(o, |of| of.ground_plane),
        set: |o, value| {
            let flag = flag(&value)?;
            set_posterior(o, |of| of.ground_plane = flag)
        },
        ..ROW
    },
    Spec {
        name: "camera_height",
        kind: Kind::Number(Range::Positive),
        placeholder: "LENGTH",
        short: "Set the height of cameras above the ground",
        help: "Height of the cameras above the ground plane in world units, if known, such as 1.5",
        group: Group::Model,
        only: OF_POSTERIOR,
        get: |o| of_posterior(o, |of| of.camera_height),
        set: |o, value| set_posterior(o, |of| of.camera_height = value.number()),
        ..ROW
    },
    Spec {
        name: "refine_poses",
        kind: Kind::ChoiceOr("auto", &PoseMotion::NAMES),
        placeholder: "auto|independent|slow",
        short: "Correct the poses together with the objects",
        help: "Correct the poses together with the objects. Errors of frames are independent, or slow (GPS, drifting odometry); \
               auto decides by the boxes. Results have the corrected poses",
        group: Group::Poses,
        only: OF_POSTERIOR,
        get: |o| of_posterior(o, |of| of.refine_poses.map(PoseMotion::name)),
        set: |o, value| {
            let motion = value.text().map(|_| value.named()).transpose()?;
            set_posterior(o, |of| of.refine_poses = motion)
        },
        ..ROW
    },
    Spec {
        name: "fixed_extrinsics",
        short: "Keep the cameras of a rig in place",
        help: "Take the places of cameras in their rig as exact: refined poses are those of the rig alone (frames with the same \
               `rig_frame` are taken by one rig)",
        group: Group::Poses,
        only: OF_POSTERIOR,
        needs: Some("refine_poses"),
        get: |o| of_posterior(o, |of| !of.refine_extrinsics),
        set: |o, value| {
            let flag = flag(&value)?;
            set_posterior(o, |of| of.refine_extrinsics = !flag)
        },
        ..ROW
    },
    Spec {
        name: "pose_noise",
        kind: Kind::Numbers(&["RAD", "LENGTH"]),
        placeholder: "RAD,LENGTH",
        short: "Correct poses with these standard deviations",
        help: "Correct the poses: standard deviations of the rotation (radians) and shift (world units) of each frame, such as 0.01,0.05",
        group: Group::Poses,
        of: MAPS,
        only: OF_POSTERIOR,
        get: |o| {
            of_posterior(o, |of| {
                of.pose_noise.map_or(Value::Unset, |p| Value::Numbers(vec![p.rotation_sd, p.translation_sd]))
            })
        },
        set: |o, value| {
            let noise = value.pair().map(|[rotation_sd, translation_sd]| PoseNoise { rotation_sd, translation_sd });
            set_posterior(o, |of| of.pose_noise = noise)
        },
        ..ROW
    },
    Spec {
        name: "noise_model",
        kind: Kind::Levels,
        placeholder: "LEVELS",
        short: "Use given noise levels",
        help: "Use given noise levels instead of estimating them, by name (edge_noise=0.03,edge_noise_px=2), or those of an earlier \
               result. Objects are then estimated independently of each other",
        group: Group::Model,
        only: OF_POSTERIOR,
        whole_scene: false,
        get: |o| of_posterior(o, |of| Value::from(of.noise_model.as_ref())),
        set: |o, value| {
            let noise_model = match &value {
                Value::Levels(levels) => {
                    let levels = levels.iter().map(|(name, x)| (name.as_str(), *x));
                    Some(NoiseModel::new(levels).map_err(|error| error.to_string())?)
                }
                _ => None,
            };
            set_posterior(o, |of| of.noise_model = noise_model)
        },
        ..ROW
    },
    Spec {
        name: "cross_validate",
        short: "Predict each view from the others",
        help: "Leave out each view of each object, predict its box from the others, and report the agreement: a measure of quality \
               without ground truth. Takes several times as long; the summary always checks a sample of views",
        group: Group::Output,
        get: |o| match o.localize.cross_validation.extent {
            Extent::All => true.into(),
            Extent::Sample => false.into(),
            Extent::Nothing => Value::Unset,
        },
        set: |o, value| {
            o.localize.cross_validation.extent = match value.flag() {
                Some(true) => Extent::All,
                Some(false) => Extent::Sample,
                None => Extent::Nothing,
            };
            Ok(())
        },
        ..ROW
    },
    Spec {
        name: "enclosing",
        short: "Add ellipsoids around the objects",
        help: "Add to each object the ellipsoid that encloses it, parts of which may lie outside of its body: that of the paper's tables",
        group: Group::Output,
        of: &[Localize, Python],
        get: |o| o.localize.enclosing.into(),
        set: |o, value| {
            o.localize.enclosing = flag(&value)?;
            Ok(())
        },
        ..ROW
    },
    Spec {
        name: "fix",
        short: "Apply the corrections that the check proposes",
        help: "Apply the corrections that the consistency check proposes until the scene is consistent (3 at most)",
        group: Group::Corrections,
        of: &[Localize, Associate, Segment],
        get: |o| o.fix.into(),
        set: |o, value| {
            o.fix = flag(&value)?;
            Ok(())
        },
        ..ROW
    },
    Spec {
        name: "allow_inconsistent",
        short: "Continue with an inconsistent scene",
        help: "Continue with an inconsistent scene",
        group: Group::Corrections,
        of: &[Localize, Associate, Segment, Python],
        get: |o| o.localize.allow_inconsistent.into(),
        set: |o, value| {
            o.localize.allow_inconsistent = flag(&value)?;
            Ok(())
        },
        ..ROW
    },
];

/// A value of [`PosteriorOptions`], if the method is `posterior`.
fn of_posterior<T: Into<Value>>(options: &RunOptions, get: impl FnOnce(&PosteriorOptions) -> T) -> Value {
    options.localize.method.posterior_options().map_or(Value::Unset, |of| get(of).into())
}

/// Changes [`PosteriorOptions`]; other methods have none.
fn set_posterior(options: &mut RunOptions, set: impl FnOnce(&mut PosteriorOptions)) -> Result<(), String> {
    options.localize.method.posterior_options_mut().map(set);
    Ok(())
}

impl From<&NoiseModel> for Value {
    fn from(noise_model: &NoiseModel) -> Self {
        Self::Levels(noise_model.levels().map(|(name, x)| (name.to_owned(), x)).collect())
    }
}

fn flag(value: &Value) -> Result<bool, String> {
    value.flag().ok_or_else(|| format!("expected {}", Kind::Flag.expected()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::options::{Spelling, set_options};

    /// A value other than the default.
    fn other(row: &Spec<RunOptions>) -> Value {
        match row.kind {
            Kind::Flag => Value::Flag(row.default() != Value::Flag(true)),
            Kind::Number(_) => 1.5.into(),
            Kind::Whole(_) => Value::Whole(7),
            Kind::Choice(names) | Kind::ChoiceOr(_, names) => {
                let name = names.iter().find(|name| row.default().text() != Some(**name)).unwrap();
                (*name).into()
            }
            Kind::Numbers(names) => Value::Numbers((1..=names.len()).map(|k| 0.1 * k as f64).collect()),
            Kind::Text => "cylinder".into(),
            Kind::Levels => Value::Levels(vec![("edge_noise".to_owned(), 0.03)]),
        }
    }

    #[test]
    fn every_row_is_set_and_read_back() {
        for row in RUN {
            let value = other(row);
            assert_ne!(value, row.default(), "{}", row.name);
            let needed = row.needs.map(|name| (name, other(RUN.iter().find(|row| row.name == name).unwrap())));
            let method =
                row.only.filter(|(_, method)| *method != "posterior").map(|(name, method)| (name, method.into()));
            let given: Vec<(&str, Value)> =
                method.into_iter().chain(needed).chain([(row.name, value.clone())]).collect();
            let mut options = RunOptions::default();
            set_options(RUN, &given, &mut options, Spelling::Flag).unwrap();
            assert_eq!((row.get)(&options), value, "{}", row.name);
            assert!(row.help.len() > 20 && !row.help.ends_with('.'), "{}", row.help);
        }
    }

    #[test]
    fn every_option_has_a_row() {
        // All fields of the structs, so that a new one does not compile before it is here.
        let RunOptions { localize, associate: _, ids: _, fix: _ } = RunOptions::default();
        let quadlift::LocalizeOptions {
            method,
            source: _,
            min_views: _,
            max_occluded: _,
            max_truncated: _,
            measurements: _,
            enclosing: _,
            allow_inconsistent: _,
            plausible_sizes: _,
            seed: _,
            cross_validation: _,
        } = localize;
        let PosteriorOptions {
            body: _,
            priors: _,
            learn_sizes: _,
            shape_sd: _,
            robust: _,
            border_margin: _,
            pixel_noise_size: _,
            heavy_tails: _,
            correlated_views: _,
            upright: _,
            ground_plane: _,
            camera_height: _,
            occluded_edges: _,
            pose_noise: _,
            refine_poses: _,
            refine_extrinsics: _,
            by_evidence: _,
            common_errors: _,
            noise_model: _,
        } = method.posterior_options().unwrap().clone();
        // Without the priors, which are read from files, and the fields for experiments.
        let names: Vec<&str> = RUN.iter().map(|row| row.name).collect();
        let of_run = ["associate", "ids", "fix"];
        let of_localization = [
            "method",
            "source",
            "min_views",
            "max_occluded",
            "max_truncated",
            "measurement",
            "allow_inconsistent",
            "enclosing",
            "cross_validate",
        ];
        let of_method = [
            "body",
            "learn_sizes",
            "upright",
            "ground_plane",
            "camera_height",
            "pose_noise",
            "refine_poses",
            "fixed_extrinsics",
            "noise_model",
            "reg_weight",
        ];
        let expected: Vec<&str> = of_run.into_iter().chain(of_localization).chain(of_method).collect();
        assert!(expected.iter().all(|name| names.contains(name)), "{names:?}");
        assert_eq!(names.len(), expected.len());
    }

    #[test]
    fn options_that_do_not_fit_are_named_as_they_are_written() {
        let error = |given: &[(&str, Value)], spelling| {
            set_options(RUN, given, &mut RunOptions::default(), spelling).unwrap_err()
        };
        let lfd = ("method", Value::from("lfd"));
        assert_eq!(
            error(&[("camera_height", 1.0.into()), lfd.clone()], Spelling::Flag),
            "--camera-height is an option of --method posterior only"
        );
        assert_eq!(
            error(&[lfd.clone(), ("upright", false.into())], Spelling::Keyword),
            "upright is an option of method=\"posterior\" only"
        );
        assert_eq!(
            error(&[("fixed_extrinsics", true.into())], Spelling::Flag),
            "--fixed-extrinsics needs --refine-poses"
        );
        assert_eq!(
            error(&[("min_views", 0.5.into())], Spelling::Keyword),
            "min_views is 0.5; expected a whole number that is not negative"
        );
        assert_eq!(
            error(&[("body", "ball".into())], Spelling::Parameter).split(", ellipsoid").next(),
            Some("the parameter body is \"ball\"; expected one of auto")
        );
        assert!(
            error(&[("view", 1.0.into())], Spelling::Keyword)
                .starts_with("there is no option view; expected one of method")
        );
        // Defaults are options of every method.
        let mut options = RunOptions::default();
        set_options(RUN, &[lfd, ("upright", true.into()), ("noise_model", Value::Unset)], &mut options, Spelling::Flag)
            .unwrap();
        assert_eq!(options.localize.method.name(), "lfd");
    }
}
