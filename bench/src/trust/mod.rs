//! Trust: how often the truth lies in the regions that estimates come with (ours).

mod sizes;
mod regions;
mod real;
mod synthetic;

use std::path::Path;

use quadlift::solve::PosteriorOptions;

use self::real::{Against, RealSet};
use self::regions::{Coverage, Judged, LEVELS, Part, quantile};
use crate::data::data_folder;
use crate::error::Error;
use crate::progress::{Run, Steps};
use crate::report::{Headline, Report};
use crate::scores::Figure;
use crate::table::{Cell, Table};

/// Numbers of views of synthetic cells.
const VIEWS: [usize; 6] = [2, 3, 5, 10, 20, 50];

/// The first so many of them are in the short form.
const SHORT_VIEWS: usize = 3;

/// Runs the experiment with so many scenes of 100 objects in each synthetic cell: 20 of them take 22 minutes of one processor. Without
/// real data the synthetic cells remain, unless `data` names a folder that has none.
///
/// # Errors
/// [`Error::NoData`], [`Error::Read`], [`Error::Synthetic`], [`Error::Localize`].
pub fn run(data: Option<&Path>, scenes: u64, run: &Run) -> Result<Report, Error> {
    let folder = match data_folder(data) {
        Ok(folder) => Some(folder),
        Err(error) if data.is_some() => return Err(error),
        Err(_) => None,
    };
    let sets = if folder.is_some() { real::sets() } else { Vec::new() };
    let of_set = |set: &RealSet| set.steps() * if set.has_exact_boxes() { 3 } else { 2 };
    let of_cells = synthetic::steps(run) + sizes::steps(run);
    let steps = Steps::new("trust", sets.iter().map(of_set).sum::<usize>() + of_cells, run.progress);
    let mut report = Report::new("trust", "Trust: how often the truth lies in the regions of an estimate");
    report.text(
        "A region of an estimate contains all points within the squared Mahalanobis distance that the chi-square \
         distribution exceeds in 50, 10, 5 or 1 % of all cases. With a calibrated covariance, the truth lies inside \
         as often as the region states, and the median squared distance is 2.37 for center and extents (3 degrees of \
         freedom) and 8.34 for the whole body (9; NEES). Extents are the squared half extents along the axes of the \
         world (ellipsoids) or the logarithms of the semi-axes (other bodies).",
    );
    let mut of_sizes = sizes::table();
    match &folder {
        Some(folder) => add_real(&mut report, &mut of_sizes, folder, &sets, run.seed, &steps)?,
        None => report.text("The real data is not available: only synthetic cells are shown."),
    }
    sizes::add_synthetic(&mut of_sizes, run.scenes(scenes), run, &steps)?;
    report.table(of_sizes);
    synthetic::add(&mut report, run.scenes(scenes), run, &steps)?;
    Ok(report)
}

/// Adds the table of the real sets, and their rows to that of sizes.
fn add_real(
    report: &mut Report,
    of_sizes: &mut Table,
    folder: &Path,
    sets: &[RealSet],
    seed: u64,
    steps: &Steps,
) -> Result<(), Error> {
    let shares = LEVELS.map(|level| format!("{level} %"));
    let titles = ["set", "covariance", "objects", "region of"].into_iter().map(str::to_owned).chain(shares);
    let titles = titles.chain(["median", "first quartile", "third quartile"].map(str::to_owned));
    let mut table = Table::new("Real sets: share of the truths inside", titles);
    let of_noise: &(dyn Fn(&mut PosteriorOptions) + Sync) = &|options| options.common_errors = false;
    let mut pooled = Vec::new();
    for (name, against, change) in [
        ("noise only", Against::Truth, of_noise),
        ("default", Against::Truth, &|_| {}),
        ("default, against exact boxes", Against::ExactBoxes, &|_| {}),
    ] {
        let mut all = Vec::new();
        for set in sets.iter().filter(|set| against == Against::Truth || set.has_exact_boxes()) {
            let judged = set.judged(folder, seed, against, change, steps)?;
            push(&mut table, set.name, name, &judged);
            if name == "default" {
                let found: Vec<_> = judged.iter().filter_map(|one| one.sizes).collect();
                sizes::push(of_sizes, set.name, None, &found);
            }
            all.extend(judged);
        }
        if against == Against::Truth {
            push(&mut table, "all", name, &all);
        }
        pooled.push(all);
    }
    table.note(
        "\"Noise only\" ignores errors common to the views of an object and differences between objects \
         (`PosteriorOptions::common_errors`); the estimates are the same. LINEMOD (boxes of YOLO) and LMO (boxes of the \
         models, of visible masks, of YOLO), options of the program; TUW; KITTI with boxes of RRC and the car prior. \
         The true center of LINEMOD, LMO and TUW is that of the smallest ellipsoid around the object, which differs \
         from the center of its tangent body: on TUW's two bottles by a sixth of their length. \"Against exact \
         boxes\": the reference is the body of the same kind fitted to tight boxes of the models.",
    );
    report.table(table);
    let [noise_only, default, _] = pooled.as_slice() else { return Ok(()) };
    let center = Coverage::of(default, Part::Center);
    let row = "posterior";
    let figures = [
        ("trust_real_center_95", "share of real centers inside the region of 95 %, per cent", Some(center.inside[2])),
        ("trust_real_center_median", "median squared distance of real centers (2.37 is honest)", Some(center.median)),
        (
            "trust_real_body_median",
            "median NEES of real bodies (8.34 is honest)",
            Some(Coverage::of(default, Part::Whole).median),
        ),
        (
            "trust_real_volume",
            "median volume of the center's region, relative to one factor on all noise-only regions that has 90 % \
             inside",
            relative_volume(default, noise_only),
        ),
    ];
    report.headlines.extend(figures.into_iter().filter_map(|(id, what, x)| headline(id, what.to_owned(), x, row)));
    Ok(())
}

fn push(table: &mut Table, set: &str, covariance: &str, judged: &[Judged]) {
    for part in Part::ALL {
        let coverage = Coverage::of(judged, part);
        let label = [set.into(), covariance.into(), Cell::number(coverage.count as f64, 0), part.name().into()];
        table.push(label.into_iter().chain(coverage.cells()).collect());
    }
}

/// Median volume of the region of 95 % of the center, relative to that of noise-only regions that are all enlarged by the
/// factor with which 90 % of the centers lie inside.
fn relative_volume(default: &[Judged], noise_only: &[Judged]) -> Option<f64> {
    let sorted = |judged: &[Judged], of: fn(&Judged) -> f64| {
        let mut values: Vec<f64> = judged.iter().map(of).collect();
        values.sort_by(f64::total_cmp);
        values
    };
    let factor = quantile(&sorted(noise_only, |one| one.errors.center), 0.9) / Part::Center.quantiles()[2];
    let median = |judged: &[Judged]| quantile(&sorted(judged, |one| one.log_volume), 0.5);
    let ratio = (median(default) - median(noise_only) - 1.5 * factor.ln()).exp();
    ratio.is_finite().then_some(ratio)
}

fn headline(id: &'static str, what: String, value: Option<f64>, row: &str) -> Option<Headline> {
    let ours = Figure { value: value?, standard_error: None };
    Some(Headline { id, what, paper: None, ours, row: row.to_owned(), decimals: 2 })
}
