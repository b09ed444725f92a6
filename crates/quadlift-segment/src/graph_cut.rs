//! The minimum cut of a grid whose pixels are joined to their eight neighbors.
//!
//! Own code, because none of the crates for general graphs that are kept up to date has an algorithm made for images:
//! Boykov and Kolmogorov, "An experimental comparison of min-cut/max-flow algorithms for energy minimization in
//! vision", PAMI 2004, on a grid without lists of edges.

use std::collections::VecDeque;

/// The neighbors of a pixel, as steps in x and y; the opposite of number d is number 7 - d.
pub(crate) const NEIGHBORS: [(i32, i32); 8] = [(-1, -1), (0, -1), (1, -1), (-1, 0), (1, 0), (-1, 1), (0, 1), (1, 1)];

/// What a pixel hangs on in its tree, where it is not a neighbor.
const TERMINAL: u8 = 8;
const ORPHAN: u8 = 9;
const NOTHING: u8 = 10;

/// The tree that a pixel belongs to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Tree {
    None,
    Object,
    Background,
}

/// A binary labelling problem on a grid.
///
/// The cost of a labelling is the sum, over the pixels labeled against the sign of their log-odds, of the log-odds'
/// size, and of the weights between neighbors with different labels.
#[derive(Debug, Clone)]
pub(crate) struct GraphCut {
    width: usize,
    height: usize,
    /// Width with the frame of unused pixels that saves looking for the border.
    stride: usize,
    /// What still fits from the object's terminal into a pixel (positive) or from it to the other one (negative).
    terminal: Vec<f32>,
    /// What still fits along the edge to each neighbor.
    capacity: Vec<[f32; 8]>,
    tree: Vec<Tree>,
    /// The neighbor (or terminal) that a pixel hangs on.
    parent: Vec<u8>,
    /// When the distance was last known to be right, and the distance to the terminal.
    stamp: Vec<u32>,
    distance: Vec<u32>,
    time: u32,
    active: VecDeque<u32>,
    is_active: Vec<bool>,
    orphans: VecDeque<u32>,
}

impl GraphCut {
    /// A problem without costs.
    pub(crate) fn new(width: usize, height: usize) -> Self {
        let stride = width + 2;
        let nodes = stride * (height + 2);
        Self {
            width,
            height,
            stride,
            terminal: vec![0.0; nodes],
            capacity: vec![[0.0; 8]; nodes],
            tree: vec![Tree::None; nodes],
            parent: vec![NOTHING; nodes],
            stamp: vec![0; nodes],
            distance: vec![0; nodes],
            time: 0,
            active: VecDeque::new(),
            is_active: vec![false; nodes],
            orphans: VecDeque::new(),
        }
    }

    fn node(&self, x: usize, y: usize) -> usize {
        (y + 1) * self.stride + x + 1
    }

    fn neighbor(&self, node: usize, direction: usize) -> usize {
        let (dx, dy) = NEIGHBORS[direction];
        node.wrapping_add_signed(dy as isize * self.stride as isize + dx as isize)
    }

    /// Sets the weight between a pixel and its neighbor, which must lie in the grid; finite and not negative.
    pub(crate) fn set_weight(&mut self, x: usize, y: usize, direction: usize, weight: f32) {
        let node = self.node(x, y);
        let neighbor = self.neighbor(node, direction);
        self.capacity[node][direction] = weight;
        self.capacity[neighbor][7 - direction] = weight;
    }

    /// The labelling with minimum cost: true for the object. Log-odds (`width * height`, row by row, finite) are
    /// positive where a pixel looks like the object; ties are background.
    pub(crate) fn solve(mut self, log_odds: &[f32]) -> Vec<bool> {
        for y in 0..self.height {
            for x in 0..self.width {
                let node = self.node(x, y);
                let odds = log_odds[y * self.width + x];
                self.terminal[node] = odds;
                if odds != 0.0 {
                    self.tree[node] = if odds > 0.0 { Tree::Object } else { Tree::Background };
                    self.parent[node] = TERMINAL;
                    self.distance[node] = 1;
                    self.activate(node);
                }
            }
        }
        self.flow();
        let rows = (0..self.height).flat_map(|y| (0..self.width).map(move |x| (x, y)));
        rows.map(|(x, y)| self.tree[self.node(x, y)] == Tree::Object).collect()
    }

    fn activate(&mut self, node: usize) {
        if !self.is_active[node] {
            self.is_active[node] = true;
            self.active.push_back(node as u32);
        }
    }

    /// Pushes flow until the trees cannot grow any more.
    fn flow(&mut self) {
        while let Some(&node) = self.active.front() {
            let node = node as usize;
            // A pixel stays at the front as long as it finds paths.
            match self.grow(node) {
                Some((node, direction)) => {
                    self.time += 1;
                    self.augment(node, direction);
                    while let Some(orphan) = self.orphans.pop_front() {
                        self.adopt(orphan as usize);
                    }
                }
                None => {
                    self.active.pop_front();
                    self.is_active[node] = false;
                }
            }
        }
    }

    /// What fits along the edge, in the direction of the flow through this tree's pixels.
    fn residual(&self, tree: Tree, node: usize, direction: usize, neighbor: usize) -> f32 {
        match tree {
            Tree::Object => self.capacity[node][direction],
            _ => self.capacity[neighbor][7 - direction],
        }
    }

    /// Takes free neighbors into the pixel's tree; returns an edge from the object's tree to the background's when it
    /// meets one.
    fn grow(&mut self, node: usize) -> Option<(usize, usize)> {
        let tree = self.tree[node];
        if tree == Tree::None {
            return None;
        }
        for direction in 0..8 {
            let neighbor = self.neighbor(node, direction);
            if self.residual(tree, node, direction, neighbor) <= 0.0 {
                continue;
            }
            if self.tree[neighbor] == Tree::None {
                self.tree[neighbor] = tree;
                self.parent[neighbor] = 7 - direction as u8;
                self.stamp[neighbor] = self.stamp[node];
                self.distance[neighbor] = self.distance[node] + 1;
                self.activate(neighbor);
            } else if self.tree[neighbor] != tree {
                return Some(if tree == Tree::Object { (node, direction) } else { (neighbor, 7 - direction) });
            } else if self.stamp[neighbor] <= self.stamp[node] && self.distance[neighbor] > self.distance[node] {
                // A shorter way to the terminal.
                self.parent[neighbor] = 7 - direction as u8;
                self.stamp[neighbor] = self.stamp[node];
                self.distance[neighbor] = self.distance[node] + 1;
            }
        }
        None
    }

    /// Pushes as much as fits along the path through the edge from `node`, which ends in both terminals.
    fn augment(&mut self, node: usize, direction: usize) {
        let other = self.neighbor(node, direction);
        let mut amount = self.capacity[node][direction];
        for start in [node, other] {
            let mut at = start;
            while self.parent[at] < TERMINAL {
                let up = usize::from(self.parent[at]);
                let parent = self.neighbor(at, up);
                // Flow comes down from the object's terminal and goes up to the background's.
                let fits = if start == node { self.capacity[parent][7 - up] } else { self.capacity[at][up] };
                amount = amount.min(fits);
                at = parent;
            }
            amount = amount.min(self.terminal[at].abs());
        }
        self.capacity[node][direction] -= amount;
        self.capacity[other][7 - direction] += amount;
        for start in [node, other] {
            let mut at = start;
            while self.parent[at] < TERMINAL {
                let up = usize::from(self.parent[at]);
                let parent = self.neighbor(at, up);
                let (from, to, along) = if start == node { (parent, at, 7 - up) } else { (at, parent, up) };
                self.capacity[from][along] -= amount;
                self.capacity[to][7 - along] += amount;
                if self.capacity[from][along] <= 0.0 {
                    self.parent[at] = ORPHAN;
                    self.orphans.push_front(at as u32);
                }
                at = parent;
            }
            self.terminal[at] -= if start == node { amount } else { -amount };
            if self.terminal[at] == 0.0 {
                self.parent[at] = ORPHAN;
                self.orphans.push_front(at as u32);
            }
        }
    }

    /// The distance of a pixel to its terminal, if its tree still leads there.
    fn rooted_distance(&mut self, start: usize) -> Option<u32> {
        let (mut at, mut steps) = (start, 0);
        let total = loop {
            if self.stamp[at] == self.time {
                break steps + self.distance[at];
            }
            match self.parent[at] {
                TERMINAL => {
                    self.stamp[at] = self.time;
                    self.distance[at] = 1;
                    break steps + 1;
                }
                ORPHAN | NOTHING => return None,
                up => at = self.neighbor(at, usize::from(up)),
            }
            steps += 1;
        };
        // What was found holds for the whole way.
        let (mut at, mut distance) = (start, total);
        while self.stamp[at] != self.time {
            self.stamp[at] = self.time;
            self.distance[at] = distance;
            distance -= 1;
            at = self.neighbor(at, usize::from(self.parent[at]));
        }
        Some(total)
    }

    /// Looks for another parent of a pixel that lost its own; without one, it and its children become free.
    fn adopt(&mut self, node: usize) {
        let tree = self.tree[node];
        let mut best: Option<(u32, u8)> = None;
        for direction in 0..8 {
            let neighbor = self.neighbor(node, direction);
            // Flow from the parent into an object's pixel, or from a background's pixel into the parent.
            let fits = match tree {
                Tree::Object => self.capacity[neighbor][7 - direction],
                _ => self.capacity[node][direction],
            };
            if fits > 0.0
                && self.tree[neighbor] == tree
                && let Some(distance) = self.rooted_distance(neighbor)
                && best.is_none_or(|(least, _)| distance < least)
            {
                best = Some((distance, direction as u8));
            }
        }
        if let Some((distance, direction)) = best {
            self.parent[node] = direction;
            self.stamp[node] = self.time;
            self.distance[node] = distance + 1;
            return;
        }
        self.parent[node] = NOTHING;
        for direction in 0..8 {
            let neighbor = self.neighbor(node, direction);
            if self.tree[neighbor] != tree {
                continue;
            }
            let fits = match tree {
                Tree::Object => self.capacity[neighbor][7 - direction],
                _ => self.capacity[node][direction],
            };
            if fits > 0.0 {
                self.activate(neighbor);
            }
            if usize::from(self.parent[neighbor]) == 7 - direction {
                self.parent[neighbor] = ORPHAN;
                self.orphans.push_back(neighbor as u32);
            }
        }
        self.tree[node] = Tree::None;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const WIDTH: usize = 4;
    const HEIGHT: usize = 3;

    /// Both ends of an edge, and its weight.
    type Edge = ((usize, usize), (usize, usize), f32);

    /// The directions that name each edge once, and whether they stay in a grid.
    fn edges(weights: &[f32]) -> (GraphCut, Vec<Edge>) {
        let mut cut = GraphCut::new(WIDTH, HEIGHT);
        let mut edges = Vec::new();
        for y in 0..HEIGHT {
            for x in 0..WIDTH {
                for (direction, (dx, dy)) in NEIGHBORS.iter().enumerate().skip(4) {
                    let (nx, ny) = (x as i32 + dx, y as i32 + dy);
                    if (0..WIDTH as i32).contains(&nx) && (0..HEIGHT as i32).contains(&ny) {
                        let weight = weights[edges.len() % weights.len()];
                        cut.set_weight(x, y, direction, weight);
                        edges.push(((x, y), (nx as usize, ny as usize), weight));
                    }
                }
            }
        }
        (cut, edges)
    }

    fn cost(labels: &[bool], log_odds: &[f32], edges: &[Edge]) -> f32 {
        let unary: f32 = labels.iter().zip(log_odds).filter(|(l, o)| **l != (**o > 0.0)).map(|(_, o)| o.abs()).sum();
        let label = |(x, y): (usize, usize)| labels[y * WIDTH + x];
        unary + edges.iter().filter(|(a, b, _)| label(*a) != label(*b)).map(|(_, _, w)| w).sum::<f32>()
    }

    proptest! {
        #![proptest_config(ProptestConfig { cases: 300, ..ProptestConfig::default() })]
        #[test]
        fn no_labelling_costs_less(
            log_odds in proptest::collection::vec(-3.0..3.0f32, WIDTH * HEIGHT),
            weights in proptest::collection::vec(prop_oneof![Just(0.0f32), 0.0..1.5f32], 29),
        ) {
            let (cut, edges) = edges(&weights);
            prop_assert_eq!(edges.len(), 29);
            let found = cost(&cut.solve(&log_odds), &log_odds, &edges);
            let least = (0u32..1 << (WIDTH * HEIGHT))
                .map(|bits| (0..WIDTH * HEIGHT).map(|i| bits >> i & 1 == 1).collect::<Vec<_>>())
                .map(|labels| cost(&labels, &log_odds, &edges))
                .fold(f32::INFINITY, f32::min);
            prop_assert!((found - least).abs() < 1e-4, "{found} {least}");
        }
    }

    #[test]
    fn without_evidence_all_is_background() {
        let (cut, _) = edges(&[1.0]);
        assert_eq!(cut.solve(&[0.0; WIDTH * HEIGHT]), [false; WIDTH * HEIGHT]);
        let (cut, _) = edges(&[1.0]);
        assert_eq!(cut.solve(&[0.5; WIDTH * HEIGHT]), [true; WIDTH * HEIGHT]);
    }
}
