//! Places of labels in a picture: beside what they name, inside of the picture, and none over another.

/// A rectangle: x0, y0, x1, y1 in pixels.
pub(super) type Rectangle = [f64; 4];

/// Cost of a label that covers objects entirely, in heights of the label that it is nearer for it.
const COVERING: f64 = 3.0;

/// Where the labels of a picture are.
pub(super) struct Places {
    size: [f64; 2],
    objects: Vec<Rectangle>,
    taken: Vec<Rectangle>,
}

impl Places {
    /// Of a picture of this size with these objects, without labels yet.
    pub(super) fn new(size: [f64; 2], objects: Vec<Rectangle>) -> Self {
        Self { size, objects, taken: Vec::new() }
    }

    /// The rectangle of a label of this width and height for an object: above, below, inside or beside it, or farther away, so
    /// that it covers little of the objects. `None` if there is no room left.
    pub(super) fn take(&mut self, object: Rectangle, label: [f64; 2]) -> Option<Rectangle> {
        let ([x0, y0, x1, y1], [width, height]) = (object, label);
        let gap = 0.1 * height;
        let beside = [
            [x0, y0 - height - gap],
            [x0, y1 + gap],
            [x1 - width, y0 - height - gap],
            [x1 - width, y1 + gap],
            [x0 + gap, y0 + gap],
            [x1 + gap, y0],
            [x0 - width - gap, y0],
        ];
        // A grid over the picture, half a label from place to place.
        let steps = [0, 1].map(|axis| (2.0 * self.size[axis] / label[axis]).max(1.0) as usize);
        let grid = (0..steps[0] * steps[1]).map(|k| {
            let cell = [k % steps[0], k / steps[0]];
            [0, 1].map(|axis| 0.5 * label[axis] * cell[axis] as f64)
        });
        let free = beside.into_iter().chain(grid).map(|corner| self.inside(corner, label)).filter(|p| self.is_free(p));
        let far = |place: Rectangle| (distance(place, object) - 1.01 * gap).max(0.0) / height;
        let cost = |place: Rectangle| far(place) + COVERING * self.covers(place);
        let costs = free.map(|place| (cost(place), place));
        let (_, place) = costs.min_by(|(a, _), (b, _)| a.total_cmp(b))?;
        self.taken.push(place);
        Some(place)
    }

    /// The share of a rectangle that lies over objects, up to one.
    fn covers(&self, place: Rectangle) -> f64 {
        let area = |[x0, y0, x1, y1]: Rectangle| (x1 - x0).max(0.0) * (y1 - y0).max(0.0);
        let common = |o: &Rectangle| [place[0].max(o[0]), place[1].max(o[1]), place[2].min(o[2]), place[3].min(o[3])];
        (self.objects.iter().map(|object| area(common(object))).sum::<f64>() / area(place)).min(1.0)
    }

    /// The rectangle with its upper left corner here, moved into the picture.
    fn inside(&self, corner: [f64; 2], label: [f64; 2]) -> Rectangle {
        let [x, y] = [0, 1].map(|axis| corner[axis].min(self.size[axis] - label[axis]).max(0.0));
        [x, y, x + label[0], y + label[1]]
    }

    fn is_free(&self, [x0, y0, x1, y1]: &Rectangle) -> bool {
        self.taken.iter().all(|[a0, b0, a1, b1]| x0 >= a1 || x1 <= a0 || y0 >= b1 || y1 <= b0)
    }
}

/// The distance between two rectangles; zero where they overlap.
fn distance(a: Rectangle, b: Rectangle) -> f64 {
    let gap = |axis: usize| (a[axis] - b[axis + 2]).max(b[axis] - a[axis + 2]).max(0.0);
    gap(0).hypot(gap(1))
}

#[cfg(test)]
mod tests {
    use super::*;

    const LABEL: [f64; 2] = [40.0, 12.0];

    fn overlap([x0, y0, x1, y1]: Rectangle, [a0, b0, a1, b1]: Rectangle) -> bool {
        x0 < a1 && a0 < x1 && y0 < b1 && b0 < y1
    }

    #[test]
    fn labels_fill_a_picture_without_covering_each_other() {
        // All objects are at the same place.
        let object = [90.0, 40.0, 120.0, 60.0];
        let mut places = Places::new([200.0, 100.0], vec![object]);
        let taken: Vec<Rectangle> = std::iter::from_fn(|| places.take(object, LABEL)).take(100).collect();
        assert!((20..=40).contains(&taken.len()), "{}", taken.len());
        for (k, place) in taken.iter().enumerate() {
            assert!(place[0] >= 0.0 && place[1] >= 0.0 && place[2] <= 200.0 && place[3] <= 100.0, "{place:?}");
            assert!(taken[..k].iter().all(|other| !overlap(*place, *other)), "{place:?}");
        }
        // The first is above it, the second below; the object is covered only where nothing else is left.
        assert!(taken[0][0] == 90.0 && taken[0][3] < 40.0, "{:?}", taken[0]);
        assert!(taken[1][0] == 90.0 && taken[1][1] > 60.0, "{:?}", taken[1]);
        assert!(taken[..8].iter().all(|place| !overlap(*place, object)), "{taken:?}");
    }

    #[test]
    fn a_label_of_an_object_at_the_border_is_inside() {
        let take = |size, object| Places::new(size, vec![object]).take(object, LABEL).unwrap();
        assert_eq!(take([200.0, 100.0], [0.0, 0.0, 200.0, 100.0]), [0.0, 0.0, 40.0, 12.0]);
        let [x0, _, x1, _] = take([200.0, 100.0], [190.0, 90.0, 200.0, 100.0]);
        assert_eq!([x0, x1], [160.0, 200.0]);
        // One that is wider than the picture begins at its left.
        assert_eq!(take([30.0, 20.0], [10.0, 5.0, 20.0, 10.0])[0], 0.0);
    }
}
