//! The result of an experiment: text, tables, plots and headline figures.

use std::fmt::Write;

use serde_json::{Value, json};

use crate::plot::Plot;
use crate::scores::Figure;
use crate::table::{Cell, Table};

/// A part of a report.
#[derive(Debug, Clone)]
pub enum Block {
    /// A paragraph.
    Text(String),
    /// A table.
    Table(Table),
    /// A plot.
    Plot(Plot),
}

/// One figure that sums up an experiment, with the best that the paper has for it.
#[derive(Debug, Clone, PartialEq)]
pub struct Headline {
    /// Short name, for programs: "kitti_rrc_aligned".
    pub id: &'static str,
    /// What it is.
    pub what: String,
    /// The paper's figure and its method.
    pub paper: Option<(f64, &'static str)>,
    /// Our figure.
    pub ours: Figure,
    /// Our row.
    pub row: String,
    /// Decimals that tables show.
    pub decimals: usize,
}

impl Headline {
    /// A figure without a standard error and without a counterpart in the paper, with three decimals.
    pub(crate) fn ours(id: &'static str, what: &str, row: &str, value: f64) -> Self {
        let ours = Figure { value, standard_error: None };
        Self { id, what: what.to_owned(), paper: None, ours, row: row.to_owned(), decimals: 3 }
    }
}

/// The result of an experiment.
#[derive(Debug, Clone)]
pub struct Report {
    /// Short name: "kitti".
    pub name: &'static str,
    /// Heading.
    pub title: &'static str,
    /// The parts, in their order.
    pub blocks: Vec<Block>,
    /// The figures that sum it up.
    pub headlines: Vec<Headline>,
}

impl Report {
    /// A report without parts.
    pub fn new(name: &'static str, title: &'static str) -> Self {
        Self { name, title, blocks: Vec::new(), headlines: Vec::new() }
    }

    /// Adds a paragraph.
    pub fn text(&mut self, text: impl Into<String>) {
        self.blocks.push(Block::Text(text.into()));
    }

    /// Adds a table.
    pub fn table(&mut self, table: Table) {
        self.blocks.push(Block::Table(table));
    }

    /// The plots.
    pub fn plots(&self) -> impl Iterator<Item = &Plot> {
        self.blocks.iter().filter_map(|block| match block {
            Block::Plot(plot) => Some(plot),
            _ => None,
        })
    }

    /// The figure with this id.
    pub fn headline(&self, id: &str) -> Option<&Headline> {
        self.headlines.iter().find(|headline| headline.id == id)
    }

    /// The report as text for a terminal, without plots.
    pub fn to_text(&self) -> String {
        let mut text = format!("{}\n{}\n\n", self.title, "=".repeat(self.title.len()));
        for block in &self.blocks {
            match block {
                Block::Text(paragraph) => text.push_str(&format!("{paragraph}\n\n")),
                Block::Table(table) => text.push_str(&format!("{}\n", table.to_text())),
                Block::Plot(_) => {}
            }
        }
        text
    }

    /// The report in Markdown, under a heading of the second level; `plots` is the folder of the plots.
    pub fn to_markdown(&self, plots: &str) -> String {
        let mut text = format!("## {}\n\n", self.title);
        for block in &self.blocks {
            // Writing to a String cannot fail.
            let _ = match block {
                Block::Text(paragraph) => writeln!(text, "{paragraph}\n"),
                Block::Table(table) => writeln!(text, "{}", table.to_markdown()),
                Block::Plot(plot) => writeln!(text, "![{}]({plots}/{}.svg)\n", plot.title, plot.name),
            };
        }
        text
    }

    /// The report as JSON: `{"experiment", "title", "text", "tables", "plots", "headlines"}`.
    pub fn to_json(&self) -> Value {
        let mut paragraphs = Vec::new();
        let (mut tables, mut plots) = (Vec::new(), Vec::new());
        for block in &self.blocks {
            match block {
                Block::Text(text) => paragraphs.push(text.as_str()),
                Block::Table(table) => tables.push(table.to_json()),
                Block::Plot(plot) => plots.push(plot.to_json()),
            }
        }
        let headline = |h: &Headline| {
            json!({
                "id": h.id, "what": h.what, "row": h.row, "ours": h.ours.value, "standard_error": h.ours.standard_error,
                "paper": h.paper.map(|(value, method)| json!({ "value": value, "method": method })),
            })
        };
        json!({
            "experiment": self.name, "title": self.title, "text": paragraphs, "tables": tables, "plots": plots,
            "headlines": self.headlines.iter().map(headline).collect::<Vec<_>>(),
        })
    }
}

/// The figures that sum up the experiments, in one table.
pub fn summary(reports: &[Report]) -> Table {
    let mut table = Table::new("In short", ["experiment", "what", "paper", "paper's method", "ours", "our row"]);
    for report in reports {
        for headline in &report.headlines {
            let (paper, method) = match headline.paper {
                Some((value, method)) => (Cell::number(value, headline.decimals.min(2)), method.into()),
                None => (Cell::Empty, Cell::Empty),
            };
            let ours = Cell::figure(Some(headline.ours), headline.decimals);
            table.push(vec![
                report.name.into(),
                headline.what.as_str().into(),
                paper,
                method,
                ours,
                headline.row.as_str().into(),
            ]);
        }
    }
    table.note("± is the standard error of the mean, from the spread over the objects.");
    table
}

/// The whole page in Markdown. `command` is what made it, `plots` the folder of the plots.
pub fn page(reports: &[Report], command: &str, plots: &str) -> String {
    let mut text = format!(
        "# The paper's experiments, rerun\n\n<!-- Written by `{command}`; do not edit. -->\n\nThe experiments of \
         section 5 of *3D Pose from Detections* (Rubino, Crocco, Perina, Murino, Del Bue, ICCV 2015), with the \
         paper's printed figures in the rows whose setting is \"paper\". This page is written by\n\n    \
         {command}\n\nThe same seed gives the same page, with any number of threads. The real data is not part of the \
         project (its licenses do not allow it); `--data DIR` or the environment variable `QUADLIFT_DATA` sets the \
         folder that contains its `scenes`. `synthetic` and `few-views` need no data.\n\n{CONVENTIONS}\n"
    );
    let _ = writeln!(text, "{}", summary(reports).to_markdown());
    for report in reports {
        text.push_str(&report.to_markdown(plots));
    }
    // One line break at the end, as in every file.
    format!("{}\n", text.trim_end())
}

/// Conventions of all tables.
pub const CONVENTIONS: &str = "\
An average is the mean over the sequences, as in the paper. O3D is the volume of the intersection over that of the \
union of the estimated and the true ellipsoid, 0 if the estimate is not an ellipsoid or the method needs more views; \
theta_err is the angle between their main axes in radians, over the objects with an ellipsoid. Objects that are \
detected in fewer than two of the views do not count. No estimator reads the truth, and every setting is the same for \
all sequences.
";

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_summary_has_a_row_for_each_headline() {
        let mut report = Report::new("tuw", "TUW");
        let ours = Figure { value: 0.8123, standard_error: None };
        let what = "O3D".to_owned();
        report.headlines.push(Headline {
            id: "x",
            what,
            paper: Some((0.55, "PfD+REG+ES")),
            ours,
            row: "posterior".into(),
            decimals: 3,
        });
        let text = summary(std::slice::from_ref(&report)).to_markdown();
        assert!(text.contains("| tuw | O3D | 0.55 | PfD+REG+ES | 0.812 | posterior |"), "{text}");
        assert_eq!(report.headline("x").unwrap().ours, ours);
        assert!(page(&[report], "quadlift-bench all", "results").ends_with("\n"));
    }
}
