//! The available TUW sequence (PfD section 5.3, table `tab:iros`): six objects on a table, eight views.

use std::path::Path;

use quadlift::solve::PosteriorOptions;

use crate::data::TrueScene;
use crate::error::Error;
use crate::methods::{MethodRow, closed_forms, run_rows};
use crate::paper::{TUW_O3D, TUW_SEQUENCES, TUW_THETA_ERR};
use crate::progress::{Run, Steps};
use crate::report::{Headline, Report};
use crate::scores::{Measure, pooled};
use crate::sequences::Columns;

/// Name of the available sequence in the table.
const DEMO: &str = "demo";

const MEASURES: [Measure; 3] = [Measure::O3d, Measure::EnclosingO3d, Measure::ThetaErr];

/// The rows: all settings of this experiment.
fn rows() -> Vec<MethodRow> {
    let mut rows = closed_forms();
    rows.push(MethodRow::posterior("auto", PosteriorOptions::default()));
    rows
}

/// Runs the experiment.
///
/// # Errors
/// [`Error::Read`], [`Error::Localize`].
pub(crate) fn run(data: &Path, run: &Run) -> Result<Report, Error> {
    let scenes = [TrueScene::read(data, "tuw_demo", DEMO)?];
    let rows = rows();
    let steps = Steps::new("tuw", rows.len(), run.progress);
    let protocol = |options: &mut quadlift::LocalizeOptions| {
        options.source = Some("authors".to_owned());
        options.seed = run.seed;
    };
    let scores = run_rows(&rows, &scenes, &protocol, &steps)?;
    let mut report = Report::new("tuw", "TUW: several objects on a table (section 5.3)");
    report.text(
        "One sequence is available, with the boxes that the authors published with a later paper (source `authors`), \
         which does not state which sequence it is. Not reproducible with this data: the other four sequences, and \
         the ellipses from segmented images (PfD+ES, PfD+REG+ES). The paper's average is over its five sequences; our \
         standard errors are over the six objects.",
    );
    let columns = Columns { averaged: &[DEMO], pooled: None, beside: &TUW_SEQUENCES };
    let mut table = columns.table("TUW");
    for row in &TUW_O3D {
        columns.push_paper(&mut table, &TUW_SEQUENCES, row, Measure::O3d);
    }
    for row in &TUW_THETA_ERR {
        columns.push_paper(&mut table, &TUW_SEQUENCES, row, Measure::ThetaErr);
    }
    for ours in &scores {
        columns.push_ours(&mut table, &[DEMO], ours, &MEASURES);
    }
    table.push(vec!["the other four sequences".into(), "ours".into(), "not reproducible: no data".into()]);
    table.push(vec!["ES".into(), "ours".into(), "not reproducible: no images".into()]);
    report.table(table);
    if let Some(map) = scores.iter().find(|s| s.row.method == "posterior")
        && let Some(ours) = pooled(&[Measure::O3d.values(&map.sequences[0])])
    {
        report.headlines.push(Headline {
            id: "tuw_default",
            what: "O3D (paper: five sequences; ours: one)".to_owned(),
            paper: Some((TUW_O3D[3].average, TUW_O3D[3].method)),
            ours,
            row: map.row.name(),
            decimals: 3,
        });
    }
    Ok(report)
}
