//! The best pairing of two sets where each has at most one partner: the assignment problem (Hungarian method) on a
//! sparse table of gains.

use crate::sorting::StableSort;

/// Steps of the Hungarian method beyond which a connected part of the table is paired greedily instead; only a mass of
/// boxes in one place leads there.
const MAX_STEPS: usize = 200_000_000;

/// A possible pair.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Pair {
    /// Index on the one side.
    pub row: u32,
    /// Index on the other side.
    pub column: u32,
    /// What the pair is worth; only pairs with a positive gain are made.
    pub gain: f64,
}

/// Places (in `pairs`, ascending) of the pairs with the greatest total gain, every row and column used once at most.
pub(crate) fn best_pairs(pairs: &[Pair]) -> Vec<usize> {
    let useful: Vec<usize> = (0..pairs.len()).filter(|&k| pairs[k].gain > 0.0 && pairs[k].gain.is_finite()).collect();
    let mut chosen = Vec::new();
    for part in connected_parts(pairs, useful) {
        if part.len() == 1 {
            chosen.push(part[0]);
        } else {
            pair_up(pairs, &part, &mut chosen);
        }
    }
    chosen.sort_unstable();
    chosen
}

/// The parts of the table that share no row or column with each other.
fn connected_parts(pairs: &[Pair], useful: Vec<usize>) -> Vec<Vec<usize>> {
    let numbered = |mut labels: Vec<u32>| {
        labels.sort_unstable();
        labels.dedup();
        labels
    };
    let rows = numbered(useful.iter().map(|&k| pairs[k].row).collect());
    let columns = numbered(useful.iter().map(|&k| pairs[k].column).collect());
    let mut parent: Vec<usize> = (0..rows.len() + columns.len()).collect();
    fn root(parent: &mut [usize], mut node: usize) -> usize {
        while parent[node] != node {
            parent[node] = parent[parent[node]];
            node = parent[node];
        }
        node
    }
    let row_node = |k: usize| rows.partition_point(|&r| r < pairs[k].row);
    let column_node = |k: usize| rows.len() + columns.partition_point(|&c| c < pairs[k].column);
    for &k in &useful {
        let (a, b) = (root(&mut parent, row_node(k)), root(&mut parent, column_node(k)));
        parent[a.max(b)] = a.min(b);
    }
    let mut labeled: Vec<(usize, usize)> = useful.iter().map(|&k| (root(&mut parent, row_node(k)), k)).collect();
    labeled.sort_unstable();
    labeled.chunk_by(|a, b| a.0 == b.0).map(|part| part.iter().map(|&(_, k)| k).collect()).collect()
}

/// Pairs up one connected part.
fn pair_up(pairs: &[Pair], part: &[usize], chosen: &mut Vec<usize>) {
    let labels = |side: fn(&Pair) -> u32| {
        let mut labels: Vec<u32> = part.iter().map(|&k| side(&pairs[k])).collect();
        labels.sort_unstable();
        labels.dedup();
        labels
    };
    let (rows, columns) = (labels(|p| p.row), labels(|p| p.column));
    // The method wants as many columns as rows at least.
    let (n, m) = (rows.len().min(columns.len()), rows.len().max(columns.len()));
    if n.saturating_mul(n).saturating_mul(m) > MAX_STEPS {
        return pair_greedily(pairs, part.to_vec(), chosen);
    }
    let turned = rows.len() > columns.len();
    let mut gains = vec![0.0f64; n * m];
    let mut places = vec![usize::MAX; n * m];
    for &k in part {
        let row = rows.partition_point(|&r| r < pairs[k].row);
        let column = columns.partition_point(|&c| c < pairs[k].column);
        let at = if turned { column * m + row } else { row * m + column };
        if pairs[k].gain > gains[at] {
            (gains[at], places[at]) = (pairs[k].gain, k);
        }
    }
    for (row, column) in hungarian(&gains, n, m).into_iter().enumerate() {
        let place = places[row * m + column];
        if place != usize::MAX {
            chosen.push(place);
        }
    }
}

/// The column of each of `n` rows (of `m >= n` columns) with the greatest total gain: shortest augmenting paths with
/// potentials, O(n^2 m).
fn hungarian(gains: &[f64], n: usize, m: usize) -> Vec<usize> {
    // Columns count from 1; 0 stands for the row that looks for a column.
    let (mut row_potential, mut column_potential) = (vec![0.0; n], vec![0.0; m + 1]);
    let mut row_of = vec![usize::MAX; m + 1];
    for start in 0..n {
        row_of[0] = start;
        let mut column = 0;
        let mut distance = vec![f64::INFINITY; m + 1];
        let mut before = vec![0; m + 1];
        let mut done = vec![false; m + 1];
        while row_of[column] != usize::MAX {
            done[column] = true;
            let row = row_of[column];
            let (mut nearest, mut next) = (f64::INFINITY, 0);
            for c in 1..=m {
                if done[c] {
                    continue;
                }
                let reduced = -gains[row * m + c - 1] - row_potential[row] - column_potential[c];
                if reduced < distance[c] {
                    (distance[c], before[c]) = (reduced, column);
                }
                if distance[c] < nearest {
                    (nearest, next) = (distance[c], c);
                }
            }
            for c in 0..=m {
                if done[c] {
                    row_potential[row_of[c]] += nearest;
                    column_potential[c] -= nearest;
                } else {
                    distance[c] -= nearest;
                }
            }
            column = next;
        }
        while column != 0 {
            let previous = before[column];
            row_of[column] = row_of[previous];
            column = previous;
        }
    }
    let mut columns = vec![0; n];
    for c in 1..=m {
        if row_of[c] != usize::MAX {
            columns[row_of[c]] = c - 1;
        }
    }
    columns
}

/// Places (in `pairs`) of the pairs that are made if the greatest gains are taken first, every row and column used once at most.
pub(crate) fn greedy_pairs(pairs: &[Pair]) -> Vec<usize> {
    let mut chosen = Vec::new();
    pair_greedily(pairs, (0..pairs.len()).collect(), &mut chosen);
    chosen
}

/// [`greedy_pairs`] of a part of the pairs.
fn pair_greedily(pairs: &[Pair], mut order: Vec<usize>, chosen: &mut Vec<usize>) {
    order.stable_sort_by(|&a, &b| pairs[b].gain.total_cmp(&pairs[a].gain).then(a.cmp(&b)));
    let (mut rows, mut columns) = (std::collections::HashSet::new(), std::collections::HashSet::new());
    for k in order {
        if !rows.contains(&pairs[k].row) && !columns.contains(&pairs[k].column) {
            rows.insert(pairs[k].row);
            columns.insert(pairs[k].column);
            chosen.push(k);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// The greatest total by trying everything.
    fn brute_force(pairs: &[Pair], used_columns: &mut Vec<u32>, row: u32) -> f64 {
        if row == 6 {
            return 0.0;
        }
        let mut best = brute_force(pairs, used_columns, row + 1);
        for pair in pairs.iter().filter(|p| p.row == row && p.gain > 0.0) {
            if !used_columns.contains(&pair.column) {
                used_columns.push(pair.column);
                best = best.max(pair.gain + brute_force(pairs, used_columns, row + 1));
                used_columns.pop();
            }
        }
        best
    }

    fn table(raw: &[(u32, u32, f64)]) -> Vec<Pair> {
        raw.iter().map(|&(row, column, gain)| Pair { row, column, gain }).collect()
    }

    proptest! {
        #[test]
        fn no_other_pairing_is_worth_more(raw in prop::collection::vec((0..6u32, 0..7u32, -2.0..9.0f64), 0..40)) {
            let pairs = table(&raw);
            let chosen = best_pairs(&pairs);
            for (i, &a) in chosen.iter().enumerate() {
                prop_assert!(pairs[a].gain > 0.0);
                for &b in &chosen[..i] {
                    prop_assert!(pairs[a].row != pairs[b].row && pairs[a].column != pairs[b].column);
                }
            }
            let total: f64 = chosen.iter().map(|&k| pairs[k].gain).sum();
            prop_assert!((total - brute_force(&pairs, &mut Vec::new(), 0)).abs() < 1e-9);
        }
    }

    #[test]
    fn greedy_and_best_differ_where_they_should() {
        let pairs = table(&[(0, 0, 3.0), (0, 1, 2.0), (1, 0, 2.5)]);
        assert_eq!(best_pairs(&pairs), [1, 2]);
        assert_eq!(greedy_pairs(&pairs), [0]);
        // Of equal gains the first one.
        assert_eq!(greedy_pairs(&table(&[(0, 0, 1.0), (1, 1, 2.0), (0, 1, 2.0), (1, 2, 1.0)])), [1, 0]);
    }

    #[test]
    fn nothing_and_what_is_not_finite_give_no_pairs() {
        assert!(best_pairs(&[]).is_empty());
        assert!(best_pairs(&table(&[(0, 0, f64::NAN), (1, 1, f64::INFINITY), (2, 2, -1.0)])).is_empty());
    }
}
