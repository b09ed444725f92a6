//! What commands said about scenes, counted by mistake, as a table.

use crate::table::{Cell, Table};

/// Cases that a table names, so that they can be repeated.
const MAX_CASES: usize = 12;

/// What a command said about a scene.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Verdict {
    /// It says that something is wrong, or refuses the answer.
    pub noticed: bool,
    /// It says so, and the first cause that it names is the right one; of a right scene, it names any.
    pub named: bool,
    /// The answer is wrong.
    pub wrong: bool,
    /// The wrong scene is about as consistent as the right one, because of where its cameras are.
    pub hidden: bool,
}

impl Verdict {
    /// Whether the answer is wrong, and nothing is said.
    fn is_wrong_and_ok(self) -> bool {
        self.wrong && !self.noticed
    }
}

/// The verdicts about one mistake, each with a seed that makes the scene again.
#[derive(Debug, Clone, Default)]
pub(super) struct Row {
    /// The mistake.
    pub name: String,
    /// Whether the command has a name for the cause.
    pub has_cause: bool,
    /// Seeds, mistakes (with their numbers) and verdicts.
    pub verdicts: Vec<(u64, String, Verdict)>,
}

/// Counts over verdicts.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Counts {
    pub scenes: usize,
    pub noticed: usize,
    pub named: usize,
    /// Where the data could show it.
    pub wrong_and_ok: usize,
    pub hidden: usize,
}

impl Counts {
    fn of<'a>(verdicts: impl Iterator<Item = &'a Verdict>) -> Self {
        verdicts.fold(Self::default(), |sum, verdict| Self {
            scenes: sum.scenes + 1,
            noticed: sum.noticed + usize::from(verdict.noticed),
            named: sum.named + usize::from(verdict.noticed && verdict.named),
            wrong_and_ok: sum.wrong_and_ok + usize::from(verdict.is_wrong_and_ok() && !verdict.hidden),
            hidden: sum.hidden + usize::from(verdict.is_wrong_and_ok() && verdict.hidden),
        })
    }

    /// Share of the scenes; 0 of none.
    pub(super) fn share(&self, count: usize) -> f64 {
        count as f64 / self.scenes.max(1) as f64
    }

    fn cells(&self, name: &str, has_cause: bool) -> Vec<Cell> {
        let count = |n: usize| Cell::number(n as f64, 0);
        let named = if has_cause { count(self.named) } else { Cell::Empty };
        vec![name.into(), count(self.scenes), count(self.noticed), named, count(self.wrong_and_ok), count(self.hidden)]
    }
}

/// The verdicts of a command.
#[derive(Debug, Clone, Default)]
pub(super) struct Verdicts {
    /// One row for each mistake.
    pub rows: Vec<Row>,
    /// Those about right scenes, with their seeds.
    pub right: Vec<(u64, Verdict)>,
}

impl Verdicts {
    /// Adds a verdict to the row of its name, which is made if it is new.
    pub(super) fn push(&mut self, name: &str, has_cause: bool, verdict: (u64, String, Verdict)) {
        if !self.rows.iter().any(|row| row.name == name) {
            self.rows.push(Row { name: name.to_owned(), has_cause, verdicts: Vec::new() });
        }
        self.rows.iter_mut().filter(|row| row.name == name).for_each(|row| row.verdicts.push(verdict.clone()));
    }

    /// Counts over all mistakes.
    pub(super) fn all(&self) -> Counts {
        Counts::of(self.rows.iter().flat_map(|row| &row.verdicts).map(|(_, _, verdict)| verdict))
    }

    /// Counts over right scenes.
    pub(super) fn of_right(&self) -> Counts {
        Counts::of(self.right.iter().map(|(_, verdict)| verdict))
    }

    /// The table; `wrong` says which answers are wrong.
    pub(super) fn table(&self, command: &str, wrong: &str) -> Table {
        let columns = ["mistake", "scenes", "noticed", "named", "wrong and ok", "the same, hidden"];
        let mut table = Table::new(format!("Verdicts: {command}"), columns);
        for row in &self.rows {
            table.push(Counts::of(row.verdicts.iter().map(|(_, _, verdict)| verdict)).cells(&row.name, row.has_cause));
        }
        table.push(self.all().cells("all", true));
        table.push(self.of_right().cells("none: right scenes", true));
        table.note(format!("Wrong: {wrong}."));
        let bad = |verdict: &Verdict| verdict.is_wrong_and_ok() && !verdict.hidden;
        let cases = self.rows.iter().flat_map(|row| &row.verdicts).filter(|(_, _, verdict)| bad(verdict));
        let cases: Vec<String> = cases.map(|(seed, mistake, _)| format!("{mistake}, seed {seed}")).collect();
        let refused = self.right.iter().filter(|(_, verdict)| verdict.noticed);
        let refused: Vec<String> = refused.map(|(seed, _)| seed.to_string()).collect();
        for (title, all) in [("Wrong and ok", cases), ("Right scenes that were refused: seeds", refused)] {
            if !all.is_empty() {
                let dots = if all.len() > MAX_CASES { "; ..." } else { "" };
                table.note(format!("{title}: {}{dots}.", all[..all.len().min(MAX_CASES)].join("; ")));
            }
        }
        table
    }
}
