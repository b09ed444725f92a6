//! `quadlift localize`: from detections to objects.

mod direct;

use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::{Context, anyhow};
use clap::builder::RangedU64ValueParser;
use clap::builder::{PossibleValuesParser, TypedValueParser};
use quadlift::association::AssociateOptions;
use quadlift::cross_validation::Extent;
use quadlift::solve::{BodyKind, Estimate, Method, PoseNoise, Rejection, Sigmas, Status};
use quadlift::{LocalizeOptions, MeasurementKind};
use quadlift_io::association::{add_to_result, association_record};
use quadlift_io::calibration::{ResultAndTruth, calibrate, calibration_record};
use quadlift_io::correct::RecordCorrection;
use quadlift_io::diagnosis::refuse_objects;
use quadlift_io::guard::check_not_read;
use quadlift_io::scene_file::{Detail, write_localized_file};
use quadlift_io::scene_file::{count_localised, cross_validation_record, noise_record, skipped_record};
use quadlift_io::{SceneFile, read_scene_file, write_scene_file};
use serde_json::{Value, json};

use crate::args::{self, BodyChoice, SigmaSource};
use crate::association::{IdsName, When, associate_and_check, associated_scene, localize_in_words};
use crate::corrections::{CheckArgs, CorrectedScene, Corrections, corrected_in_words};
use crate::diagnosis::Check;
use crate::error::{InconsistentError, Outcome, in_words, usage};
use crate::estimate_table::{noise_levels, render, summaries};
use crate::files::{check_file, check_result_name, expand, outputs};
use crate::localization::{
    PriorSource, Settings, localize_scene, read_masks, result_file, result_file_without_objects,
};
use crate::next::{Next, Word};
use crate::output::{HEADING, Output, one_line};
use crate::report::{check_report, report_paths, write_localized};
use crate::words::{count, duration};

/// Estimate 3D objects from the detections of a scene
///
/// The result is a scene file: the cameras and frames of the scene, the estimated objects with status, uncertainty and
/// residuals, and the settings. The true objects of a scene, if it has any, are neither read nor copied.
#[derive(clap::Args)]
#[command(
    verbatim_doc_comment,
    after_help = "\
Several scenes (several paths, a folder, or a pattern in quotes) are localised one after another; OUT is then a folder,
and each result has the file name of its scene. If a scene fails, it is reported and the others are still processed.

--cameras and --detections read files of other programs and detect their formats; the main options of `quadlift import`
and `quadlift import-detections` are available here too.

Examples:
  quadlift localize scene.json -o estimate.json --report estimate.html
  quadlift localize --cameras sparse/0 --detections runs/detect/predict -o objects.json
  quadlift localize street.json -o cars.json --source yolo --body cuboid --priors builtin
  quadlift localize scenes/ -o estimates/
  quadlift localize 'scenes/kitti_*.json' -o estimates/ --json

Exit codes: 0 success; 1 a scene failed, or none of its objects could be localised; 2 wrong usage; 3 a scene is
inconsistent (poses, cameras and boxes do not fit together), and --accept-inconsistent is not given."
)]
pub struct Args {
    /// Scene files, folders that hold them, or patterns in quotes
    #[arg(required_unless_present = "cameras", conflicts_with = "cameras", value_name = "SCENE.json")]
    scenes: Vec<PathBuf>,

    /// Output file (for several scenes: a folder); without it the result is only printed
    #[arg(short, long, value_name = "OUT.json")]
    output: Option<PathBuf>,

    /// Write an HTML report (for several scenes: a folder)
    #[arg(long, value_name = "OUT.html")]
    report: Option<PathBuf>,

    /// Level of detail of the result: full, or brief (no covariances, no figures of single views; a third of the size)
    #[arg(long, value_enum, value_name = "WHAT", default_value_t = DetailName::Full, hide_possible_values = true)]
    detail: DetailName,

    /// Estimator: map (refinement, the best), planes, lfd and pfd (closed forms), reg (the regularised one)
    #[arg(long, value_name = "METHOD", default_value = "map", value_parser = method(), hide_possible_values = true)]
    method: Method,

    /// Weight of the regulariser, for --method reg only [default: 1e16]
    #[arg(long, value_name = "X", value_parser = args::finite)]
    lambda: Option<f64>,

    /// Kind of body to fit: ellipsoid, cuboid, cylinder, superellipsoid:Q (Q from 1, cuboid, to 2, ellipsoid), or auto:
    /// selected for each object, an ellipsoid without evidence for another kind
    #[arg(long, value_name = "BODY", default_value = "auto", value_parser = args::body_choice)]
    body: BodyChoice,

    /// Use only the detections of this source; required if the scene has several
    #[arg(long, value_name = "NAME")]
    source: Option<String>,

    /// Measurements to use: auto (what a detection has; if both, the box for position and size, the ellipse for shape),
    /// box, ellipse, box+ellipse, or mask (its outline, with map and planes). Detections without the selected
    /// measurement are skipped
    #[arg(long, value_name = "WHAT", default_value = "auto", value_parser = observations(), hide_possible_values = true)]
    observations: MeasurementKind,

    /// Associate detections that show the same object first: auto (if any lack an id), never or always
    #[arg(long, value_enum, value_name = "WHEN", default_value_t = When::Auto, hide_possible_values = true)]
    associate: When,

    /// How far to trust existing ids: trust, evidence or ignore [default: trust; with --associate always:
    /// evidence]
    #[arg(long, value_enum, value_name = "WHAT", hide_possible_values = true)]
    ids: Option<IdsName>,

    /// Priors on categories: "builtin" (for scenes in metres) or a TOML file
    #[arg(long, value_name = "builtin|FILE.toml")]
    priors: Option<PathBuf>,

    /// Skip objects with fewer views
    #[arg(long, value_name = "N", default_value_t = 0, hide_default_value = true)]
    min_views: usize,

    /// Skip detections that are more occluded (KITTI: 0 visible, 1 partly, 2 largely, 3 unknown)
    #[arg(long, value_name = "LEVEL", value_parser = args::finite)]
    max_occluded: Option<f64>,

    /// Skip detections that are more truncated (KITTI: 0 entirely inside the image)
    #[arg(long, value_name = "LEVEL", value_parser = args::finite)]
    max_truncated: Option<f64>,

    /// Do not detect which objects stand upright (with an axis along the scene's `up`)
    #[arg(long)]
    no_upright: bool,

    /// All objects stand on a common ground plane, which is estimated (the scene needs `up`)
    #[arg(long)]
    ground_plane: bool,

    /// Height of the cameras above the ground plane in world units, if known
    #[arg(long, value_name = "H", value_parser = args::positive)]
    camera_height: Option<f64>,

    /// Correct the poses: standard deviations of the rotation (radians) and shift (world units) of each frame
    #[arg(long, value_name = "RAD,LENGTH", value_parser = args::pose_noise)]
    pose_noise: Option<PoseNoise>,

    /// Use given noise levels instead of estimating them: from an earlier result, or by name
    /// (edge_relative=0.03,edge_px=2). Objects are then estimated independently of each other
    #[arg(long, value_name = "RESULT.json|NAME=X,...", value_parser = args::sigmas)]
    sigmas: Option<SigmaSource>,

    /// Leave out each view of each object, predict its box from the others, and report the agreement: a measure of
    /// quality without ground truth. Takes several times as long; the summary always checks a sample of views
    #[arg(long)]
    cross_validate: bool,

    /// Calibrate the confidence regions on an earlier result and the scene with its true objects (may be repeated): the
    /// result then lists calibrated limits
    #[arg(long, num_args = 2, value_names = ["RESULT.json", "TRUTH.json"], action = clap::ArgAction::Append)]
    calibration: Vec<PathBuf>,

    /// Seed of the random numbers
    #[arg(long, value_name = "N", default_value_t = 0)]
    seed: u64,

    /// Number of threads [default: one per core]; the result does not depend on it
    #[arg(long, value_name = "N", value_parser = RangedU64ValueParser::<usize>::new().range(1..=1024))]
    threads: Option<usize>,

    #[command(flatten)]
    corrections: Corrections,

    #[command(flatten)]
    check: CheckArgs,

    #[command(flatten)]
    direct: direct::DirectArgs,
}

/// The command, in which options that have no effect on scene files need `--cameras`.
pub fn with_requirements(command: clap::Command) -> clap::Command {
    direct::ONLY_DIRECT.iter().fold(command, |command, id| command.mut_arg(id, |option| option.requires("cameras")))
}

#[derive(Debug, Clone, Copy, PartialEq, clap::ValueEnum)]
enum DetailName {
    Full,
    Brief,
}

impl From<DetailName> for Detail {
    fn from(name: DetailName) -> Self {
        match name {
            DetailName::Full => Self::Full,
            DetailName::Brief => Self::Brief,
        }
    }
}

impl Args {
    fn settings(&self) -> anyhow::Result<Settings> {
        let mut method = self.method.clone();
        let options_of_map = [
            (self.body.0.is_some_and(|body| body != BodyKind::Ellipsoid), "--body is an option"),
            (
                self.ground_plane || self.camera_height.is_some() || self.pose_noise.is_some(),
                "--ground-plane, --camera-height and --pose-noise are options",
            ),
            (self.no_upright, "--no-upright is an option"),
            (self.sigmas.is_some(), "--sigmas is an option"),
            (self.priors.is_some(), "--priors is an option"),
        ];
        match &mut method {
            Method::Map(map) => {
                map.body = self.body.0;
                map.upright = !self.no_upright;
                map.ground_plane = self.ground_plane;
                map.camera_height = self.camera_height;
                map.pose_noise = self.pose_noise;
                map.sigmas = self.sigmas.as_ref().map(read_sigmas).transpose()?;
            }
            _ => {
                if let Some((_, what)) = options_of_map.into_iter().find(|(given, _)| *given) {
                    return usage(format!("{what} of --method map only"));
                }
                if !self.calibration.is_empty() {
                    return usage(
                        "--calibration is an option of --method map only: the other methods give no covariance",
                    );
                }
            }
        }
        match (&mut method, self.lambda) {
            (Method::Reg(reg), Some(lambda)) => reg.lambda = lambda,
            (_, Some(_)) => return usage("--lambda is an option of --method reg only"),
            _ => {}
        }
        let priors = match &self.priors {
            None => PriorSource::None,
            Some(name) if name.as_os_str() == "builtin" => PriorSource::Builtin,
            Some(path) => PriorSource::File(path.clone()),
        };
        let mut options = LocalizeOptions {
            method,
            source: self.source.clone(),
            min_views: self.min_views,
            max_occluded: self.max_occluded,
            max_truncated: self.max_truncated,
            measurements: self.observations,
            seed: self.seed,
            accept_inconsistent: self.check.accept_inconsistent,
            ..Default::default()
        };
        if self.cross_validate {
            options.cross_validation.extent = Extent::All;
        }
        Settings::new(options, priors)
    }
}

/// Reads a method by its name.
fn method() -> impl TypedValueParser<Value = Method> {
    PossibleValuesParser::new(Method::NAMES).try_map(|name| name.parse::<Method>())
}

/// Reads a kind of measurement by its name.
fn observations() -> impl TypedValueParser<Value = MeasurementKind> {
    PossibleValuesParser::new(MeasurementKind::NAMES).try_map(|name| name.parse::<MeasurementKind>())
}

/// Noise levels that were given, or those of an earlier result.
fn read_sigmas(source: &SigmaSource) -> anyhow::Result<Sigmas> {
    match source {
        SigmaSource::Given(sigmas) => Ok(sigmas.clone()),
        SigmaSource::Result(path) => {
            let file = read_scene_file(path)?;
            file.noise_levels().map_err(|error| error.in_file(path).into())
        }
    }
}

/// The requested calibration in the format of results.
fn read_calibration(paths: &[PathBuf]) -> anyhow::Result<Option<Value>> {
    if paths.is_empty() {
        return Ok(None);
    }
    let files = paths.iter().map(|path| read_scene_file(path)).collect::<Result<Vec<_>, _>>()?;
    let files: Vec<(&Path, &SceneFile)> = paths.iter().map(PathBuf::as_path).zip(&files).collect();
    let pairs: Vec<ResultAndTruth> = files.chunks_exact(2).map(|pair| [pair[0], pair[1]]).collect();
    let calibration = calibrate(&pairs)?;
    let names: Vec<[&Path; 2]> = pairs.iter().map(|[result, truth]| [result.0, truth.0]).collect();
    Ok(Some(calibration_record(&calibration, &names)))
}

/// The calibration in one line.
fn calibration_in_words(record: &Value) -> String {
    let objects = record["objects"].as_u64().unwrap_or(0) as usize;
    // The quantile of chi-square with 3 degrees of freedom.
    let said = match record["squared_distance"]["center"]["0.95"].as_f64() {
        Some(limit) => format!("the 95 % region of a centre ends at a squared distance of {limit:.2} instead of 7.81"),
        None => "too few for a 95 % region".to_owned(),
    };
    format!("regions calibrated on {}: {said}\n", count(objects, "object"))
}

pub fn run(args: &Args, out: &Output) -> anyhow::Result<Outcome> {
    if let Some(threads) = args.threads {
        // Before anything else: the first call of the library starts the threads.
        rayon::ThreadPoolBuilder::new().num_threads(threads).build_global().context("cannot start the threads")?;
    }
    args.output.as_deref().map_or(Ok(()), |output| check_result_name(output, true))?;
    let settings = args.settings()?;
    let calibration = read_calibration(&args.calibration)?;
    let calibration = calibration.as_ref();
    if let Some((cameras, detections)) = args.direct.paths() {
        let [output, report] = [&args.output, &args.report].map(Option::as_deref);
        output.map_or(Ok(()), check_file)?;
        let others: Vec<&Path> = [cameras, detections].into_iter().chain(output).collect();
        check_report(args.report.as_ref(), &others)?;
        // The base folder of image paths.
        let place = output.or(report);
        let scene = || {
            let (file, frame_offset) = args.direct.read([cameras, detections], place, args.source.as_deref(), out)?;
            // The size of the images and the numbers of the frames are dealt with where detections are added.
            let mut scene = CorrectedScene::of(file, &args.corrections.list(None, None), detections)?;
            scene.frame_offset = frame_offset;
            scene.corrections.extend(args.direct.pixels_and_frames().0.map(RecordCorrection::ImageSize));
            Ok(scene)
        };
        let mut document =
            json!({ "cameras": cameras.display().to_string(), "detections": detections.display().to_string() });
        let named = [detections, place.unwrap_or(Path::new(""))];
        let outcome = one_scene(named, scene, [output, report], args, (&settings, calibration), out, &mut document)?;
        if outcome == Outcome::Fine {
            next_steps(None, [output, report]).tell(out)?;
        }
        out.document(&json!({ "scenes": [document] }))?;
        return Ok(outcome);
    }
    let inputs = expand(&args.scenes)?;
    let outputs = args.output.as_ref().map(|output| outputs(&inputs, output)).transpose()?;
    let reports =
        args.report.as_ref().map(|report| report_paths(&inputs, report, args.output.as_deref())).transpose()?;
    let mut documents = Vec::with_capacity(inputs.paths.len());
    let mut outcome = Outcome::Fine;
    // One scene after another: the largest one bounds the memory.
    for (index, input) in inputs.paths.iter().enumerate() {
        let [output, report] = [&outputs, &reports].map(|paths| paths.as_ref().map(|paths| paths[index].as_path()));
        let mut document = json!({ "scene": input.display().to_string() });
        if index > 0 {
            out.report("\n")?;
        }
        let (image_size, frame_offset) = args.direct.pixels_and_frames();
        let corrections = args.corrections.list(image_size, frame_offset);
        let scene = || {
            let mut scene = CorrectedScene::read(input, &corrections)?;
            args.direct.min_score().map_or(Ok(()), |least| scene.leave_out_below(least, input))?;
            Ok(scene)
        };
        let chosen = (&settings, calibration);
        match one_scene([input, input], scene, [output, report], args, chosen, out, &mut document) {
            Ok(ended) => outcome = outcome.and(ended),
            Err(error) => {
                out.error(&in_words(&error));
                document["error"] = in_words(&error).into();
                outcome = outcome.and(match error.downcast_ref::<InconsistentError>() {
                    Some(InconsistentError { diagnosis, .. }) => {
                        document["diagnosis"] = diagnosis.clone();
                        Outcome::Inconsistent
                    }
                    None => Outcome::SomethingFailed,
                });
            }
        }
        documents.push(document);
    }
    if let ([scene], Outcome::Fine) = (&inputs.paths[..], outcome) {
        let [output, report] = [&outputs, &reports].map(|paths| paths.as_ref().map(|paths| paths[0].as_path()));
        next_steps(Some(scene), [output, report]).tell(out)?;
    }
    out.document(&json!({ "scenes": documents }))?;
    Ok(outcome)
}

/// Suggested next commands for the result.
fn next_steps(scene: Option<&Path>, [output, report]: [Option<&Path>; 2]) -> Next {
    let mut next = Next::default();
    match (output, report) {
        (None, None) => next.again("-o objects.json --report objects.html", "save the result and a report"),
        (Some(output), report) => {
            if report.is_none() {
                let files = scene.into_iter().chain([output]).map(Word::from);
                next = next.command([Word::from("view")].into_iter().chain(files), "view it in the browser");
            }
            next.command(["export ply".into(), output.into(), "-o objects.ply".into()], "export for other programs")
        }
        (None, Some(_)) => next,
    }
}

/// Reads and localises a scene, writes and prints the result and adds it to the JSON document. `input` names it, the paths
/// in it are relative to the file `place`.
fn one_scene(
    [input, place]: [&Path; 2],
    read: impl FnOnce() -> anyhow::Result<CorrectedScene>,
    [output, report]: [Option<&Path>; 2],
    args: &Args,
    (settings, calibration): (&Settings, Option<&Value>),
    out: &Output,
    document: &mut Value,
) -> anyhow::Result<Outcome> {
    let start = Instant::now();
    let title = input.display().to_string();
    let mut corrected = read()?;
    [output, report].into_iter().flatten().try_for_each(check_not_read)?;
    let source = settings.options.source.as_deref();
    let ids = args.associate.ids_for(&corrected.scene, source, args.ids);
    let mut check = Check::new(&mut corrected, &args.check, source, ids, input)?;
    let read = start.elapsed();
    let mut association = None;
    if let Some(ids) = ids {
        let options = AssociateOptions {
            source: settings.options.source.clone(),
            ids,
            priors: settings.priors_on_categories(),
            ..Default::default()
        };
        let found = associate_and_check(&title, &mut corrected, input, &options, &mut check, out);
        association = Some((ids, found.with_context(|| title.clone())?));
    }
    let CorrectedScene { mut file, mut scene, notes, .. } = corrected;
    let problems =
        read_masks(&title, (place, &file), &mut scene, &settings.options, out).with_context(|| title.clone())?;
    file.objects = Vec::new();
    // The page shows masks, which are named by the detections.
    let images = report.map(|_| file.to_images(place).map_err(|error| error.in_file(place))).transpose()?;
    // Detections are the bulk of a large scene; a result has them where their identities are found.
    let detections = std::mem::take(&mut file.detections);
    let mut identities = None;
    if let Some((ids, association)) = association {
        let words = localize_in_words(&scene, source, ids, &association);
        scene = associated_scene(&scene, &association, source)?;
        document["association"] = association_record(&scene, &association);
        identities = Some((detections, association, words));
    } else {
        drop(detections);
    }
    let mut localization = localize_scene(&title, &scene, settings, out).with_context(|| title.clone())?;
    if identities.is_some() {
        // Told with the identities.
        localization.skipped.without_object = 0;
    }
    check.update(&localization.diagnosis);
    refuse_objects(&mut localization, &check.diagnosis, args.check.accept_inconsistent);
    document["diagnosis"] = check.record();
    let solved = start.elapsed();
    let estimates = &localization.estimates;
    let found = identities.as_ref().map_or(String::new(), |(.., words)| format!("{words}\n\n"));
    // Records of all objects at once are only made for what needs them.
    let needs_records = report.is_some() || identities.is_some();
    let mut result = if needs_records {
        result_file(&file, &scene, &localization, settings)
    } else {
        result_file_without_objects(&file, &localization, settings)
    };
    if let Some(about) = &mut result.localization {
        about["diagnosis"] = check.record();
        if !notes.is_empty() {
            about["corrections"] = json!(notes);
            document["corrections"] = json!(notes);
        }
        if let Some(calibration) = calibration {
            about["calibration"] = calibration.clone();
        }
    }
    if let Some((detections, association, _)) = identities {
        add_to_result(&mut result, detections, &scene, source, &association);
    }
    if let Some(output) = output {
        let detail = Detail::from(args.detail);
        if needs_records && detail == Detail::Full {
            write_scene_file(output, &result)?;
        } else if needs_records {
            // The page shows everything.
            let mut brief = result.clone();
            brief.objects.iter_mut().for_each(|object| detail.apply(object));
            write_scene_file(output, &brief)?;
        } else {
            write_localized_file(output, &result, &scene, &localization, detail)?;
        }
        document["output"] = output.display().to_string().into();
    }
    if let (Some(report), Some(images)) = (report, &images) {
        write_localized(report, (place, &file), images, &scene, &result)?;
        document["report"] = report.display().to_string().into();
    }
    let localised = count_localised(estimates);
    let mut text = format!(
        "{HEADING}{}{HEADING:#}: {localised} of {} localised ({})\n\n",
        one_line(&title),
        count(estimates.len(), "object"),
        settings.in_words(localization.body)
    );
    text.push_str(&corrected_in_words(&notes));
    text.push_str(&found);
    if !out.json && !out.quiet {
        text.push_str(&render(&scene, &localization, settings));
    }
    text.push_str(&calibration.map_or(String::new(), calibration_in_words));
    for path in [output, report].into_iter().flatten() {
        text.push_str(&format!("wrote {}\n", path.display()));
    }
    out.report(&text)?;
    for estimate in estimates {
        let rejected: Vec<String> = estimate
            .views
            .iter()
            .filter_map(|view| Some((&scene.frames[view.frame_index].id, view.rejected_because?)))
            .map(|(frame, because)| format!("{frame} ({})", rejection_in_words(because)))
            .collect();
        if !rejected.is_empty() {
            let id = &scene.object_ids[estimate.object_index];
            out.detail(&one_line(&format!("{id}: rejected the views {}", rejected.join(", "))));
        }
    }
    if let Some(levels) = noise_levels(&localization) {
        out.detail(&levels);
    }
    out.detail(&format!("read in {}, localised in {}", duration(read), duration(solved - read)));
    if out.json {
        document["objects"] = serde_json::to_value(summaries(&scene, &localization))?;
        document["localised"] = localised.into();
        document["noise"] = noise_record(&localization).into();
        document["cross_validation"] = cross_validation_record(&localization);
        document["skipped"] = skipped_record(&localization);
        if let Some(calibration) = calibration {
            document["calibration"] = calibration.clone();
        }
    }
    out.errors(&problems);
    if !problems.is_empty() {
        document["problems"] = json!(problems);
    }
    // Rays that do not cross (all from one point, one view of each object) cannot disagree.
    let undetermined = |e: &Estimate| matches!(e.status, Status::Degenerate | Status::TooFewViews);
    let cannot_tell = !check.is_explained() && estimates.iter().all(undetermined);
    let outcome = if cannot_tell { Outcome::Fine } else { check.tell(&title, out) };
    if localised == 0 && outcome == Outcome::Fine {
        return Err(anyhow!("{title}: no object could be localised"));
    }
    Ok(if problems.is_empty() { outcome } else { Outcome::SomethingFailed })
}

/// Why a view was not used.
fn rejection_in_words(because: Rejection) -> &'static str {
    match because {
        Rejection::Residual => "residual",
        Rejection::BehindCamera => "behind the camera",
    }
}
