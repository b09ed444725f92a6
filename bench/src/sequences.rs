//! Tables with one column for each sequence, an average over some of them, and the paper's rows above ours.

use crate::methods::RowScores;
use crate::paper;
use crate::scores::{Measure, average, pooled};
use crate::table::{Cell, Table};

/// Title of the column with the mean over the sequences.
const AVERAGE: &str = "average";

/// The sequences of a table.
#[derive(Debug, Clone, Copy)]
pub struct Columns<'a> {
    /// Sequences that make up the average.
    pub averaged: &'a [&'a str],
    /// Title of a column with the mean over all objects of these sequences; none without a title.
    pub pooled: Option<&'a str>,
    /// Sequences that are shown beside it.
    pub beside: &'a [&'a str],
}

impl Columns<'_> {
    /// An empty table with these columns.
    pub fn table(&self, title: impl Into<String>) -> Table {
        let titles = ["method", "setting", "measure"].iter().chain(self.averaged).chain(&[AVERAGE]);
        Table::new(title, titles.copied().chain(self.pooled).chain(self.beside.iter().copied()))
    }

    /// Adds our figures, one row for each measure that has any; `names` are those of the sequences of the scores.
    pub fn push_ours(&self, table: &mut Table, names: &[&str], ours: &RowScores, measures: &[Measure]) {
        for &measure in measures {
            let values = |name: &&str| match names.iter().position(|n| n == name) {
                Some(index) => measure.values(&ours.sequences[index]),
                None => Vec::new(),
            };
            let averaged: Vec<Vec<f64>> = self.averaged.iter().map(values).collect();
            let beside: Vec<Vec<f64>> = self.beside.iter().map(values).collect();
            if averaged.iter().chain(&beside).all(Vec::is_empty) {
                continue;
            }
            let decimals = measure.decimals();
            let cell =
                |values: &Vec<f64>| crate::scores::mean(values).map_or(Cell::Empty, |x| Cell::number(x, decimals));
            let mut row = vec![ours.row.method.into(), ours.row.setting.as_str().into(), measure.name().into()];
            row.extend(averaged.iter().map(cell));
            row.push(Cell::figure(average(&averaged), decimals));
            row.extend(self.pooled.map(|_| Cell::figure(pooled(&averaged), decimals)));
            row.extend(beside.iter().map(cell));
            table.push(row);
        }
    }

    /// Adds a row of the paper; `names` are those of its sequences.
    pub fn push_paper<const N: usize>(
        &self,
        table: &mut Table,
        names: &[&str; N],
        row: &paper::Row<N>,
        measure: Measure,
    ) {
        // Two decimals, as printed; percentages have none.
        let decimals = measure.decimals().min(2);
        let figure = |title: &str| {
            let value = match names.iter().position(|name| *name == title) {
                Some(index) => row.figures[index],
                None => (title == AVERAGE).then_some(row.average),
            };
            value.map_or(Cell::Empty, |value| Cell::number(value, decimals))
        };
        let figures: Vec<Cell> = table.columns[3..].iter().map(|title| figure(title)).collect();
        table.push([row.method.into(), "paper".into(), measure.name().into()].into_iter().chain(figures).collect());
    }
}
