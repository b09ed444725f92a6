//! The tree of frames: links with their transforms over time, and poses between them.

use std::collections::{BTreeMap, VecDeque};
use std::fmt;

use nalgebra::Isometry3;

use super::messages::Transform;

/// Frames of a log, at most.
const MAX_FRAMES: usize = 10_000;
/// Transforms that a link keeps, at most.
const MAX_KEPT: usize = 100_000;
/// How long a link of a log keeps transforms, in nanoseconds.
const KEPT: i64 = 30 * SECOND;
/// A second in nanoseconds.
pub(super) const SECOND: i64 = 1_000_000_000;

/// The tree of frames.
#[derive(Debug)]
pub(super) struct Tree {
    links: BTreeMap<String, Link>,
    /// How long a link keeps transforms, in nanoseconds.
    kept: i64,
}

impl Default for Tree {
    fn default() -> Self {
        Self::keeping(KEPT)
    }
}

/// The link from a frame to its parent.
#[derive(Debug)]
struct Link {
    parent: String,
    transforms: Transforms,
}

#[derive(Debug)]
enum Transforms {
    /// It holds at every time.
    Fixed(Isometry3<f64>),
    /// By their times, in nanoseconds.
    Moving(VecDeque<(i64, Isometry3<f64>)>),
}

/// How far poses may be from the transforms.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Limits {
    /// Largest time to the nearest transform where there is none on the other side, nanoseconds.
    pub tolerance: i64,
    /// Longest time between two transforms that is interpolated, nanoseconds.
    pub longest_gap: i64,
}

/// Why there is no pose.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct NoPose {
    pub problem: String,
    /// Whether later transforms may change that.
    pub may_come: bool,
    /// Whether the time is before the first transform of a link or after its last one, as at both ends of many logs.
    pub is_outside: bool,
}

/// A pose, and how it was found.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Pose {
    /// Maps points of the source to points of the target.
    pub target_from_source: Isometry3<f64>,
    /// How the least certain link was found.
    pub how: How,
}

/// How a transform was found, from the best to the worst.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum How {
    /// There is one for this time.
    Exact,
    /// Between two that are so many nanoseconds apart.
    Between(i64),
    /// The nearest one, so many nanoseconds away.
    Nearest(i64),
}

/// A time for people.
pub(super) struct Seconds(pub i64);

impl fmt::Display for Seconds {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let sign = if self.0 < 0 { "-" } else { "" };
        let (seconds, rest) = (self.0.unsigned_abs() / 1_000_000_000, self.0.unsigned_abs() % 1_000_000_000);
        write!(f, "{sign}{seconds}.{rest:09}")
    }
}

/// A duration for people: in seconds, with three digits.
pub(super) fn duration(nanoseconds: i64) -> String {
    let seconds = nanoseconds as f64 * 1e-9;
    let digits = if seconds.abs() >= 100.0 {
        0
    } else if seconds.abs() >= 1.0 {
        2
    } else {
        4
    };
    let text = format!("{seconds:.digits$}");
    let text = if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.') } else { &text };
    format!("{text} s")
}

impl Tree {
    /// An empty tree whose links keep the transforms of so many nanoseconds.
    pub(super) fn keeping(kept: i64) -> Self {
        Self { links: BTreeMap::new(), kept }
    }

    /// Takes in a transform. `is_fixed`: it holds at every time.
    ///
    /// # Errors
    /// A text if the child has another parent, or if there are too many frames.
    pub(super) fn insert(&mut self, transform: Transform, is_fixed: bool) -> Result<(), String> {
        let Transform { stamp, parent, child, parent_from_child } = transform;
        if let Some(link) = self.links.get_mut(&child) {
            if link.parent != parent {
                return Err(format!(
                    "the frame \"{child}\" has the parents \"{}\" and \"{parent}\"; the first one is used",
                    link.parent
                ));
            }
            match &mut link.transforms {
                Transforms::Fixed(known) if is_fixed => *known = parent_from_child,
                Transforms::Fixed(_) => {}
                Transforms::Moving(list) => {
                    let at = list.partition_point(|(time, _)| *time < stamp);
                    match list.get_mut(at) {
                        Some((time, known)) if *time == stamp => *known = parent_from_child,
                        _ => list.insert(at, (stamp, parent_from_child)),
                    }
                    if list.len() > MAX_KEPT {
                        list.pop_front();
                    }
                }
            }
            return Ok(());
        }
        if self.links.len() >= MAX_FRAMES {
            return Err(format!("the log has more than {MAX_FRAMES} frames; \"{child}\" is left out"));
        }
        let transforms = match is_fixed {
            true => Transforms::Fixed(parent_from_child),
            false => Transforms::Moving(VecDeque::from([(stamp, parent_from_child)])),
        };
        self.links.insert(child, Link { parent, transforms });
        Ok(())
    }

    /// The time of the newest transform of a frame to its parent.
    pub(super) fn newest(&self, child: &str) -> Option<i64> {
        match &self.links.get(child)?.transforms {
            Transforms::Fixed(_) => None,
            Transforms::Moving(list) => list.back().map(|(time, _)| *time),
        }
    }

    /// Forgets what is older than the newest transform of its link, and than this time, by more than the time that is kept.
    pub(super) fn forget_before(&mut self, time: i64) {
        for link in self.links.values_mut() {
            if let Transforms::Moving(list) = &mut link.transforms
                && let Some(&(newest, _)) = list.back()
            {
                let first = newest.min(time).saturating_sub(self.kept);
                // One before it stays, to interpolate from.
                while list.get(1).is_some_and(|(time, _)| *time < first) {
                    list.pop_front();
                }
            }
        }
    }

    /// How many moving transforms are kept.
    #[cfg(test)]
    pub(super) fn transforms(&self) -> usize {
        let kept = |link: &Link| match &link.transforms {
            Transforms::Fixed(_) => 0,
            Transforms::Moving(list) => list.len(),
        };
        self.links.values().map(kept).sum()
    }

    /// Forgets all moving transforms, but not the links.
    pub(super) fn forget_moving(&mut self) {
        for link in self.links.values_mut() {
            if let Transforms::Moving(list) = &mut link.transforms {
                list.clear();
            }
        }
    }

    /// Gives a frame this parent, and no other.
    pub(super) fn replace(&mut self, transform: Transform) {
        let Transform { parent, child, parent_from_child, .. } = transform;
        self.links.insert(child, Link { parent, transforms: Transforms::Fixed(parent_from_child) });
    }

    /// A frame and those above it, except for the root.
    pub(super) fn ancestors<'a>(&'a self, frame: &'a str) -> Vec<&'a str> {
        self.way_up(frame).into_iter().map(|(name, _)| name).collect()
    }

    /// The frame at the top of the tree that a frame is in.
    pub(super) fn root<'a>(&'a self, frame: &'a str) -> &'a str {
        self.way_up(frame).last().map_or(frame, |(_, link)| &link.parent)
    }

    /// The frames without a parent.
    pub(super) fn roots(&self) -> Vec<&str> {
        let mut roots: Vec<&str> = self.links.values().map(|link| link.parent.as_str()).collect();
        roots.retain(|name| !self.links.contains_key(*name));
        roots.sort_unstable();
        roots.dedup();
        roots
    }

    /// Whether both frames are in one tree.
    pub(super) fn is_connected(&self, a: &str, b: &str) -> bool {
        self.root(a) == self.root(b)
    }

    /// The links from a frame up to its root. Where they lead in a circle, each comes once.
    fn way_up<'a>(&'a self, frame: &'a str) -> Vec<(&'a str, &'a Link)> {
        let mut way: Vec<(&str, &Link)> = Vec::new();
        let mut current = frame;
        while let Some((name, link)) = self.links.get_key_value(current) {
            // A circle: its length is bounded by the number of frames.
            if way.len() > self.links.len() {
                break;
            }
            way.push((name, link));
            current = &link.parent;
        }
        way
    }

    /// The pose of a frame in another one at a time. `is_final`: no more transforms come.
    ///
    /// # Errors
    /// [`NoPose`] names the link.
    pub(super) fn pose(
        &self,
        target: &str,
        source: &str,
        time: i64,
        limits: Limits,
        is_final: bool,
    ) -> Result<Pose, NoPose> {
        let unconnected = || NoPose {
            problem: format!("no transforms lead from the frame \"{source}\" to \"{target}\""),
            may_come: !is_final,
            // Both are connected in the whole log, or they would not have been chosen.
            is_outside: true,
        };
        let (mut from_source, mut from_target) = (self.way_up(source), self.way_up(target));
        if self.root(source) != self.root(target) {
            return Err(unconnected());
        }
        // What both have in common is of no use.
        while let (Some((a, _)), Some((b, _))) = (from_source.last(), from_target.last())
            && a == b
        {
            from_source.pop();
            from_target.pop();
        }
        let mut how = How::Exact;
        let mut up = |way: &[(&str, &Link)]| {
            let mut top_from_frame = Isometry3::identity();
            for (child, link) in way {
                let (parent_from_child, found) = link.at(child, time, limits, is_final)?;
                top_from_frame = parent_from_child * top_from_frame;
                how = how.max(found);
            }
            Ok(top_from_frame)
        };
        let (top_from_source, top_from_target) = (up(&from_source)?, up(&from_target)?);
        Ok(Pose { target_from_source: top_from_target.inverse() * top_from_source, how })
    }
}

impl Link {
    fn at(&self, child: &str, time: i64, limits: Limits, is_final: bool) -> Result<(Isometry3<f64>, How), NoPose> {
        let list = match &self.transforms {
            Transforms::Fixed(transform) => return Ok((*transform, How::Exact)),
            Transforms::Moving(list) => list,
        };
        let link = format!("{} -> {child}", self.parent);
        let at = list.partition_point(|(known, _)| *known < time);
        let before = at.checked_sub(1).and_then(|at| list.get(at));
        let after = list.get(at);
        match (before, after) {
            (_, Some((known, transform))) if *known == time => Ok((*transform, How::Exact)),
            (Some(&(t0, a)), Some(&(t1, b))) => {
                let gap = t1 - t0;
                let (nearest, distance) = if time - t0 <= t1 - time { (a, time - t0) } else { (b, t1 - time) };
                if gap <= limits.longest_gap {
                    let share = (time - t0) as f64 / gap as f64;
                    return Ok((interpolated(&a, &b, share), How::Between(gap)));
                }
                if distance <= limits.tolerance {
                    return Ok((nearest, How::Nearest(distance)));
                }
                let problem = format!(
                    "the transforms {link} have a gap of {} around the time {}; at most {} are interpolated (--max-gap)",
                    duration(gap),
                    Seconds(time),
                    duration(limits.longest_gap)
                );
                Err(NoPose { problem, may_come: false, is_outside: false })
            }
            (None, None) => {
                let problem = format!("there is no transform {link} near the time {}", Seconds(time));
                Err(NoPose { problem, may_come: !is_final, is_outside: true })
            }
            (before, after) => {
                let is_late = after.is_none();
                let Some(&(known, transform)) = before.or(after) else {
                    return Err(NoPose { problem: String::new(), may_come: false, is_outside: true });
                };
                let distance = (time - known).abs();
                if is_late && !is_final {
                    return Err(NoPose { problem: String::new(), may_come: true, is_outside: true });
                }
                if distance <= limits.tolerance {
                    return Ok((transform, How::Nearest(distance)));
                }
                let problem = format!(
                    "the time {} is {} {} transform {link}; at most {} are accepted (--time-tolerance)",
                    Seconds(time),
                    duration(distance),
                    if is_late { "after the last" } else { "before the first" },
                    duration(limits.tolerance)
                );
                Err(NoPose { problem, may_come: false, is_outside: true })
            }
        }
    }
}

/// Between two transforms: translations along a line, rotations at constant speed about one axis.
fn interpolated(a: &Isometry3<f64>, b: &Isometry3<f64>, share: f64) -> Isometry3<f64> {
    let translation = a.translation.vector.lerp(&b.translation.vector, share);
    // Half a turn has no shortest way; a is as good as any.
    let rotation = a.rotation.try_slerp(&b.rotation, share, 1e-9).unwrap_or(a.rotation);
    Isometry3::from_parts(translation.into(), rotation)
}

#[cfg(test)]
mod tests {
    use nalgebra::{Translation3, UnitQuaternion, Vector3};

    use super::*;

    const LIMITS: Limits = Limits { tolerance: SECOND / 50, longest_gap: SECOND };

    fn transform(parent: &str, child: &str, stamp: f64, x: f64, turn: f64) -> Transform {
        let rotation = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), turn);
        let parent_from_child = Isometry3::from_parts(Translation3::new(x, 0.0, 0.0), rotation);
        Transform { stamp: (stamp * 1e9).round() as i64, parent: parent.into(), child: child.into(), parent_from_child }
    }

    fn tree() -> Tree {
        let mut tree = Tree::default();
        for (time, x) in [(1.0, 1.0), (1.5, 2.0), (2.0, 2.0), (4.0, 9.0)] {
            tree.insert(transform("map", "odom", time, x, x), false).unwrap();
        }
        tree.insert(transform("odom", "base", 0.0, 0.5, 0.0), true).unwrap();
        tree.insert(transform("base", "camera", 0.0, 0.1, 1.0), true).unwrap();
        tree.insert(transform("base", "lidar", 0.0, 0.0, 0.5), true).unwrap();
        tree
    }

    #[test]
    fn poses_are_interpolated_along_the_tree() {
        let tree = tree();
        let pose = |time: f64| tree.pose("map", "camera", (time * 1e9) as i64, LIMITS, true).unwrap();
        assert_eq!((tree.root("camera"), tree.roots()), ("map", vec!["map"]));
        let exact = pose(1.5);
        assert_eq!(exact.how, How::Exact);
        // Odom is turned by 2 about z at x = 2.
        let expected = Vector3::new(2.0 + 0.6 * 2.0_f64.cos(), 0.6 * 2.0_f64.sin(), 0.0);
        assert!((exact.target_from_source.translation.vector - expected).norm() < 1e-15);
        let between = pose(1.25);
        assert_eq!(between.how, How::Between(SECOND / 2));
        assert!((between.target_from_source.rotation.angle() - 2.5).abs() < 1e-12);
        // Neither up to the root nor at any time: both frames are fixed on the robot.
        let sideways = tree.pose("lidar", "camera", 77 * SECOND, LIMITS, true).unwrap();
        assert_eq!(sideways.how, How::Exact);
        assert!((sideways.target_from_source.rotation.angle() - 0.5).abs() < 1e-12);
        let back = tree.pose("camera", "map", 1_250_000_000, LIMITS, true).unwrap();
        let there_and_back = back.target_from_source * between.target_from_source;
        assert!(there_and_back.translation.vector.norm() < 1e-15);
    }

    #[test]
    fn what_is_too_far_is_refused() {
        let tree = tree();
        let pose = |time: f64, is_final| tree.pose("map", "camera", (time * 1e9).round() as i64, LIMITS, is_final);
        assert_eq!(pose(4.02, true).unwrap().how, How::Nearest(SECOND / 50));
        assert!(pose(4.02, false).unwrap_err().may_come, "a later transform makes it more certain");
        assert_eq!(
            pose(4.5, true).unwrap_err().problem,
            "the time 4.500000000 is 0.5 s after the last transform map -> odom; at most 0.02 s are accepted \
             (--time-tolerance)"
        );
        assert!(pose(0.9, true).unwrap_err().problem.contains("0.1 s before the first transform map -> odom"));
        assert!(!pose(0.9, false).unwrap_err().may_come);
        assert_eq!(pose(2.01, true).unwrap().how, How::Nearest(SECOND / 100));
        assert!(pose(3.0, true).unwrap_err().problem.starts_with("the transforms map -> odom have a gap of 2 s"));
        let problem = tree.pose("world", "camera", 0, LIMITS, true).unwrap_err().problem;
        assert_eq!(problem, "no transforms lead from the frame \"camera\" to \"world\"");
    }

    #[test]
    fn circles_and_two_parents_do_no_harm() {
        let mut tree = Tree::default();
        tree.insert(transform("a", "b", 0.0, 1.0, 0.0), true).unwrap();
        tree.insert(transform("b", "a", 0.0, 1.0, 0.0), true).unwrap();
        let _ = (tree.root("a"), tree.pose("a", "b", 0, LIMITS, true), tree.pose("b", "a", 0, LIMITS, true));
        let error = tree.insert(transform("c", "b", 0.0, 1.0, 0.0), true).unwrap_err();
        assert_eq!(error, "the frame \"b\" has the parents \"a\" and \"c\"; the first one is used");
    }

    #[test]
    fn old_transforms_are_forgotten() {
        let mut tree = Tree::default();
        for time in 0..100 {
            tree.insert(transform("a", "b", f64::from(time), 1.0, 0.0), false).unwrap();
        }
        tree.forget_before(50 * SECOND);
        let pose = |time: i64| tree.pose("a", "b", time * SECOND, LIMITS, true);
        assert!(pose(21).is_ok() && pose(99).is_ok() && pose(10).is_err());
    }

    #[test]
    fn times_are_written_for_people() {
        assert_eq!(Seconds(-1_500_000_000).to_string(), "-1.500000000");
        assert_eq!([20_000_000, 3 * SECOND, 123_456 * SECOND].map(duration), ["0.02 s", "3 s", "123456 s"]);
    }
}
