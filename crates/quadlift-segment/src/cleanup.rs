//! Cleans up a labelling: keeps its large parts and fills holes.

/// Parts with less of the largest part's area are dropped.
const MIN_PART: f64 = 0.2;

/// Drops the small parts of a labelling of a square grid (pixels that touch along an edge belong together) and fills
/// the holes.
pub(crate) fn clean(inside: &mut [bool], grid: usize) {
    let (parts, areas) = connected(inside, grid, true);
    let largest = areas.iter().copied().max().unwrap_or(0);
    for (pixel, part) in inside.iter_mut().zip(&parts) {
        *pixel = part.is_some_and(|part| areas[part] as f64 >= MIN_PART * largest as f64);
    }
    let (parts, areas) = connected(inside, grid, false);
    let mut touches_border = vec![false; areas.len()];
    for i in 0..grid {
        for index in [i, (grid - 1) * grid + i, i * grid, i * grid + grid - 1] {
            if let Some(part) = parts[index] {
                touches_border[part] = true;
            }
        }
    }
    for (pixel, part) in inside.iter_mut().zip(&parts) {
        *pixel = *pixel || part.is_some_and(|part| !touches_border[part]);
    }
}

/// The connected part that each pixel with the value `of` belongs to, and the areas of the parts.
fn connected(inside: &[bool], grid: usize, of: bool) -> (Vec<Option<usize>>, Vec<usize>) {
    let mut parts = vec![None; inside.len()];
    let mut areas = Vec::new();
    let mut stack = Vec::new();
    for start in 0..inside.len() {
        if inside[start] != of || parts[start].is_some() {
            continue;
        }
        let part = areas.len();
        areas.push(0);
        parts[start] = Some(part);
        stack.push(start);
        while let Some(at) = stack.pop() {
            areas[part] += 1;
            let (x, y) = (at % grid, at / grid);
            let neighbors = [
                (x > 0).then(|| at - 1),
                (x + 1 < grid).then_some(at + 1),
                (y > 0).then(|| at - grid),
                (y + 1 < grid).then_some(at + grid),
            ];
            for neighbor in neighbors.into_iter().flatten() {
                if inside[neighbor] == of && parts[neighbor].is_none() {
                    parts[neighbor] = Some(part);
                    stack.push(neighbor);
                }
            }
        }
    }
    (parts, areas)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cleaned(rows: &[&str]) -> Vec<String> {
        let mut inside: Vec<bool> = rows.iter().flat_map(|row| row.bytes().map(|b| b == b'#')).collect();
        let grid = rows.len();
        clean(&mut inside, grid);
        inside.chunks(grid).map(|row| row.iter().map(|&b| if b { '#' } else { '.' }).collect()).collect()
    }

    #[test]
    fn specks_go_and_holes_close() {
        let found = cleaned(&[
            "#.......", //
            "..#####.", "..#...#.", "..#.#.#.", "..#####.", "........", ".###....", ".#......",
        ]);
        // The ring has 14 pixels: a part of four stays, one of a single pixel goes; the hole and its island fill up.
        let expected = ["........", "..#####.", "..#####.", "..#####.", "..#####.", "........", ".###....", ".#......"];
        assert_eq!(found, expected);
        assert_eq!(cleaned(&["..", ".."]), ["..", ".."]);
        // A bay that only a diagonal closes is open at the border of the grid only if it touches it.
        assert_eq!(cleaned(&[".#.", "#.#", ".#."])[1], "###");
    }
}
