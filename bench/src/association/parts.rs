//! Ablation of the parts of association: each switched off.

use std::path::Path;

use quadlift::association::{AssociateOptions, AssociationWarning, IdPolicy, Part};
use quadlift::synthetic::SyntheticOptions;
use rayon::prelude::*;

use super::case::{Case, Division, Marked};
use super::{driving, synthetic};
use crate::error::Error;
use crate::progress::{Run, Steps};
use crate::report::Report;
use crate::scores::mean;
use crate::table::{Cell, Table};

/// Scenes of each condition.
const SEEDS: u64 = 3;

/// A row: its name, whether the search is thorough, and what is switched off.
struct Row {
    name: &'static str,
    thorough: bool,
    without: Option<Part>,
}

fn rows() -> Vec<Row> {
    let without = |name, part| Row { name, thorough: false, without: Some(part) };
    let doubt = |name, reason| without(name, Part::Warning(reason));
    vec![
        Row { name: "everything", thorough: false, without: None },
        without("nested bodies stay", Part::Nested),
        without("one pass", Part::SecondPass),
        doubt("length is no reason for doubt", AssociationWarning::Elongated),
        doubt("size is no reason for doubt", AssociationWarning::UnusualSize),
        doubt("weak evidence is no reason for doubt", AssociationWarning::WeakEvidence),
        Row { name: "thorough", thorough: true, without: None },
    ]
}

impl Row {
    fn options(&self) -> AssociateOptions {
        let Self { thorough, without, .. } = *self;
        AssociateOptions { ids: IdPolicy::Ignore, thorough, without, ..Default::default() }
    }

    /// Whether the row affects more than uncertain objects.
    fn divides(&self) -> bool {
        !matches!(self.without, Some(Part::Warning(_)))
    }
}

/// The synthetic scenes of a column.
fn cases(make: &SyntheticOptions, run: &Run) -> Result<Vec<Case>, Error> {
    (0..run.scenes(SEEDS)).map(|k| synthetic::case(&SyntheticOptions { seed: run.seed + k, ..make.clone() })).collect()
}

/// Number of steps.
pub(super) fn steps(with_real_data: bool) -> usize {
    rows().len() * if with_real_data { 2 } else { 1 }
}

/// Adds the table.
///
/// # Errors
/// [`Error::Read`], [`Error::Synthetic`], [`Error::Associate`].
pub(super) fn add(data: Option<&Path>, report: &mut Report, run: &Run, steps: &Steps) -> Result<(), Error> {
    let conditions = synthetic::with_parts_to_do();
    let columns = ["part"].into_iter().chain(conditions.iter().map(|(name, _)| *name));
    let driving = ["KITTI tracking", "false objects", "uncertain ones", "uncertain true ones, %"];
    let columns: Vec<&str> = columns.chain(driving).collect();
    let scenes: Vec<Vec<Case>> = conditions.iter().map(|(_, make)| cases(make, run)).collect::<Result<_, _>>()?;
    let videos = data.map_or_else(|| Ok(Vec::new()), driving::cases)?;
    let mut table =
        Table::new(format!("Parts of association switched off, mean F1 of {} scenes", run.scenes(SEEDS)), columns);
    for row in rows() {
        let options = row.options();
        let divided = |cases: &[Case], options: &AssociateOptions| -> Result<Vec<Division>, Error> {
            cases.par_iter().map(|case| case.division(options)).collect()
        };
        let f1 = |divisions: &[Division]| mean(&divisions.iter().map(|d| d.score.f1).collect::<Vec<_>>());
        let number = |x: Option<f64>| x.map_or(Cell::Empty, |x| Cell::number(x, 4));
        let mut cells: Vec<Cell> = vec![row.name.into()];
        for cases in &scenes {
            cells.push(if row.divides() { number(f1(&divided(cases, &options)?)) } else { Cell::Empty });
        }
        steps.done();
        let driving = divided(&videos, &options)?;
        let all = |of: fn(&Division) -> Marked| driving.iter().map(of).fold(Marked::default(), Marked::and);
        let (standing, others) = (all(|d| d.standing), all(|d| d.false_objects));
        cells.push(number(f1(&driving).filter(|_| row.divides())));
        let whole = |n: usize| if driving.is_empty() { Cell::Empty } else { Cell::number(n as f64, 0) };
        cells.extend([whole(others.objects), whole(others.uncertain)]);
        cells.push(standing.share().map_or(Cell::Empty, |share| Cell::number(100.0 * share, 1)));
        table.push(cells);
        if data.is_some() {
            steps.done();
        }
    }
    table.note(
        "Conditions as above. KITTI tracking: the four sequences, false objects and uncertain ones of all of them \
         together.",
    );
    report.table(table);
    Ok(())
}
