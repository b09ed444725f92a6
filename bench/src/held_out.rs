//! Leave one sequence out: the remaining gain if a setting is chosen on the other sequences.

use crate::methods::RowScores;
use crate::scores::{Measure, average, mean};
use crate::table::{Cell, Table};

/// An empty table of the results.
pub fn table(title: &str) -> Table {
    let mut table = Table::new(
        title,
        [
            "data",
            "settings",
            "held out: average",
            "worst setting",
            "median",
            "best setting",
            "chosen without each sequence",
        ],
    );
    table.note(
        "For each sequence the setting with the best O3D on the others is scored on it. The other columns are the \
         averages of single settings, for comparison.",
    );
    table
}

/// The setting that is chosen without each sequence, as an index into `scores`: the one with the best average over the
/// others, the first of equals.
pub fn choices(scores: &[RowScores], sequences: usize, measure: Measure) -> Vec<usize> {
    let on_others = |row: &RowScores, held_out: usize| {
        let others: Vec<Vec<f64>> =
            (0..sequences).filter(|&s| s != held_out).map(|s| measure.values(&row.sequences[s])).collect();
        average(&others).map_or(f64::NEG_INFINITY, |figure| figure.value)
    };
    (0..sequences)
        .map(|held_out| {
            let values: Vec<f64> = scores.iter().map(|row| on_others(row, held_out)).collect();
            (0..values.len()).rev().max_by(|&a, &b| values[a].total_cmp(&values[b])).unwrap_or(0)
        })
        .collect()
}

/// Adds the results for one set of sequences.
pub fn push(table: &mut Table, data: &str, names: &[&str], scores: &[RowScores], measure: Measure) {
    let chosen = choices(scores, names.len(), measure);
    let values: Vec<Vec<f64>> =
        chosen.iter().enumerate().map(|(s, &row)| measure.values(&scores[row].sequences[s])).collect();
    let of_row = |row: &RowScores| {
        let values: Vec<f64> = row.sequences.iter().filter_map(|s| mean(&measure.values(s))).collect();
        mean(&values)
    };
    let mut averages: Vec<f64> = scores.iter().filter_map(of_row).collect();
    averages.sort_by(f64::total_cmp);
    let at = |index: usize| averages.get(index).map_or(Cell::Empty, |x| Cell::number(*x, measure.decimals()));
    let in_words: Vec<String> =
        names.iter().zip(&chosen).map(|(name, &row)| format!("{name}: {}", scores[row].row.setting)).collect();
    table.push(vec![
        data.into(),
        Cell::number(scores.len() as f64, 0),
        Cell::figure(average(&values), measure.decimals()),
        at(0),
        at(averages.len() / 2),
        at(averages.len().saturating_sub(1)),
        in_words.join("; ").into(),
    ]);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::methods::MethodRow;
    use quadlift::metrics::ObjectScore;
    use quadlift::solve::PosteriorOptions;

    #[test]
    fn a_setting_is_chosen_without_the_sequence_it_is_scored_on() {
        let scores = |setting: &str, o3d: [f64; 3]| RowScores {
            row: MethodRow::posterior(setting, PosteriorOptions::default()),
            sequences: o3d.map(|x| vec![ObjectScore { iou3d: Some(x), ..Default::default() }]).to_vec(),
        };
        // "a" is best on the first sequence only, "b" on the others.
        let rows = [scores("a", [1.0, 0.1, 0.1]), scores("b", [0.2, 0.4, 0.4])];
        assert_eq!(choices(&rows, 3, Measure::O3d), [1, 0, 0]);
        let mut table = table("x");
        push(&mut table, "data", &["p", "q", "r"], &rows, Measure::O3d);
        let Cell::Number { value, .. } = table.rows[0][2] else { panic!("{table:?}") };
        assert!((value - (0.2 + 0.1 + 0.1) / 3.0).abs() < 1e-12);
    }
}
