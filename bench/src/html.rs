//! The tables and plots of experiments as one page for browsers, which needs no other file.

use std::fmt::Write;

use crate::error::Error;
use crate::report::{Block, CONVENTIONS, Report, summary};
use crate::table::Table;

/// Light and dark, narrow and wide.
const STYLE: &str = "\
:root { color-scheme: light dark; --line: #d0d4d9 } @media (prefers-color-scheme: dark) { :root { --line: #3a4149 } }
body { font: 15px/1.5 system-ui, sans-serif; max-width: 1100px; margin: 0 auto; padding: 16px }
div { overflow-x: auto } table { border-collapse: collapse; font-size: 13px; font-variant-numeric: tabular-nums }
th, td { border-bottom: 1px solid var(--line); padding: 2px 10px 2px 0; text-align: left; white-space: nowrap }
td.n, th.n { text-align: right } svg { max-width: 100%; height: auto } figure { margin: 16px 0 }";

/// The page; `command` is what made it.
///
/// # Errors
/// [`Error::Plot`] with the message of the drawing library.
pub fn html_page(reports: &[Report], command: &str) -> Result<String, Error> {
    let mut page = format!(
        "<!doctype html>\n<html lang=\"en\">\n<meta charset=\"utf-8\">\n<meta name=\"viewport\" \
         content=\"width=device-width, initial-scale=1\">\n<title>The paper's experiments, rerun</title>\n\
         <style>\n{STYLE}\n</style>\n<h1>The paper's experiments, rerun</h1>\n"
    );
    let paragraph = |page: &mut String, text: &str| {
        // Writing to a String cannot fail.
        let _ = writeln!(page, "<p>{}</p>", escaped(text));
    };
    paragraph(&mut page, &format!("Written by {command}."));
    paragraph(&mut page, CONVENTIONS);
    page.push_str(&table(&summary(reports)));
    for report in reports {
        let _ = writeln!(page, "<h2>{}</h2>", escaped(report.title));
        for block in &report.blocks {
            match block {
                Block::Text(text) => paragraph(&mut page, text),
                Block::Table(block) => page.push_str(&table(block)),
                Block::Plot(plot) => {
                    let _ = writeln!(page, "<figure>\n{}</figure>", plot.svg()?);
                }
            }
        }
    }
    page.push_str("</html>\n");
    Ok(page)
}

fn table(table: &Table) -> String {
    let (cells, left) = table.shown();
    let mut html = format!("<h3>{}</h3>\n<div><table>\n", escaped(&table.title));
    for (k, row) in std::iter::once(&table.columns).chain(&cells).enumerate() {
        html.push_str("<tr>");
        let tag = if k == 0 { "th" } else { "td" };
        for (cell, left) in row.iter().zip(&left) {
            let class = if *left { "" } else { " class=\"n\"" };
            let _ = write!(html, "<{tag}{class}>{}</{tag}>", escaped(cell));
        }
        html.push_str("</tr>\n");
    }
    html.push_str("</table></div>\n");
    for note in &table.notes {
        let _ = writeln!(html, "<p>{}</p>", escaped(note));
    }
    html
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plot::{Curve, Plot};
    use crate::table::Cell;

    #[test]
    fn tables_and_plots_are_in_the_page_and_texts_stay_texts() {
        let mut report = Report::new("x", "A & B");
        report.text("noise < 5 %");
        let mut table = Table::new("T", ["name", "O3D"]);
        table.push(vec!["<b>".into(), Cell::number(0.5, 2)]);
        report.table(table);
        let curves = vec![Curve { name: "posterior".to_owned(), points: vec![(0.0, 1.0), (1.0, 0.9)] }];
        let (name, title, x_label) = ("p".to_owned(), "P".to_owned(), "x".to_owned());
        report.blocks.push(Block::Plot(Plot { name, title, x_label, curves, marks: Vec::new() }));
        let page = html_page(&[report], "quadlift-bench x").unwrap();
        for part in ["<h2>A &amp; B</h2>", "noise &lt; 5 %", "<td>&lt;b&gt;</td><td class=\"n\">0.50</td>", "<svg "] {
            assert!(page.contains(part), "{part}");
        }
        assert!(!page.contains("<b>") && !page.contains("src=") && !page.contains("href="));
    }
}
