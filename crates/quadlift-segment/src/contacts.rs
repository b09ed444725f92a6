//! Parts of the outline of a mask that are not the outline of the object: at the image border, and at another object.

use crate::mask::Mask;

/// The shares of a mask's outline that are not the object's own outline: there it may go on unseen.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Contacts {
    /// Share of the outline at the border of the image, in [0, 1].
    pub border: f64,
    /// Share of the outline at another object, in [0, 1]. Which of the two hides the other is not known.
    pub others: f64,
}

/// Share of an outline above which what is not the object's own makes the mask that of a part.
const PARTIAL: f64 = 0.05;

impl Contacts {
    /// The contacts of a mask in an image of this size (width, height) with the pixels of other objects.
    ///
    /// From each side of a pixel on the outline, the `reach` pixels (1 or more) straight ahead are looked at: 1 finds
    /// only what touches; masks of networks often keep a gap of a pixel or two. No contacts for an empty mask.
    pub fn of(mask: &Mask, [width, height]: [u32; 2], other: impl Fn(u32, u32) -> bool, reach: u32) -> Self {
        let (mut outline, mut border, mut others) = (0u64, 0u64, 0u64);
        for [x, y] in mask.pixels() {
            for (dx, dy) in [(1, 0), (-1, 0), (0, 1), (0, -1)] {
                let ahead = |step: u32| {
                    let move_by = |from: u32, by: i32| match by {
                        0 => Some(from),
                        1 => from.checked_add(step),
                        _ => from.checked_sub(step),
                    };
                    let (x, y) = (move_by(x, dx)?, move_by(y, dy)?);
                    (x < width && y < height).then_some((x, y))
                };
                if ahead(1).is_some_and(|(x, y)| mask.contains(x, y)) {
                    continue;
                }
                outline += 1;
                for step in 1..=reach.max(1) {
                    match ahead(step) {
                        None => border += 1,
                        Some((x, y)) if mask.contains(x, y) => {}
                        Some((x, y)) if other(x, y) => others += 1,
                        Some(_) => continue,
                    }
                    break;
                }
            }
        }
        let share = |count: u64| count as f64 / outline.max(1) as f64;
        Self { border: share(border), others: share(others) }
    }

    /// Whether mask and ellipse may cover only a part of the object, because too much of the outline is a contact.
    pub fn is_partial(&self) -> bool {
        self.border + self.others > PARTIAL
    }

    /// Whether the image border cuts the mask.
    pub fn truncated_by_border(&self) -> bool {
        self.border > 0.0
    }

    /// Whether the mask touches another object's.
    pub fn touches_another(&self) -> bool {
        self.others > 0.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn square(x: u32, y: u32) -> Mask {
        Mask { origin: [x, y], width: 2, height: 2, inside: vec![true; 4] }
    }

    #[test]
    fn free_masks_have_no_contacts() {
        let free = Contacts::of(&square(3, 3), [10, 10], |_, _| false, 1);
        assert_eq!(free, Contacts::default());
        assert!(!free.truncated_by_border() && !free.touches_another());
        assert_eq!(Contacts::of(&Mask::default(), [10, 10], |_, _| true, 1), Contacts::default());
    }

    #[test]
    fn each_border_is_found() {
        for (x, y, share) in [(0, 3, 0.25), (8, 3, 0.25), (3, 0, 0.25), (3, 8, 0.25), (0, 0, 0.5), (8, 8, 0.5)] {
            let contacts = Contacts::of(&square(x, y), [10, 10], |_, _| false, 1);
            assert_eq!(contacts, Contacts { border: share, others: 0.0 }, "{x} {y}");
            assert!(contacts.truncated_by_border());
        }
        assert!(Contacts::of(&square(1, 3), [10, 10], |_, _| false, 2).truncated_by_border());
    }

    #[test]
    fn neighbors_count_by_the_length_of_the_contact_and_the_reach() {
        let neighbor = square(5, 4);
        let contacts = |reach| Contacts::of(&square(3, 3), [10, 10], |x, y| neighbor.contains(x, y), reach);
        assert_eq!(contacts(1), Contacts { border: 0.0, others: 1.0 / 8.0 });
        // Beyond a gap of one pixel.
        let far = square(6, 3);
        let contacts = |reach| Contacts::of(&square(3, 3), [10, 10], |x, y| far.contains(x, y), reach);
        assert_eq!((contacts(1).others, contacts(2).others), (0.0, 0.25));
        assert!(contacts(2).touches_another());
    }

    #[test]
    fn the_own_far_side_is_no_neighbor() {
        // A ring: looking across the hole, the mask meets itself.
        let ring = Mask { origin: [3, 3], ..Mask::from_fn(3, 3, |x, y| (x, y) != (1, 1)) };
        let contacts = Contacts::of(&ring, [12, 12], |x, y| ring.contains(x, y), 3);
        assert_eq!(contacts.others, 0.0);
    }
}
