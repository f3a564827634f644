//! Masks without specks and without holes.

use scene_io::BitMask;

/// Opening: what no disc of the radius fits into is taken out. What is outside of the picture has no say.
pub(super) fn opened(mask: &BitMask, radius: u32) -> BitMask {
    grown(&shrunk(mask, radius), radius)
}

/// Closing: gaps that no disc of the radius fits into are filled.
pub(super) fn closed(mask: &BitMask, radius: u32) -> BitMask {
    shrunk(&grown(mask, radius), radius)
}

/// Every pixel that is within the radius of a set one.
fn grown(mask: &BitMask, radius: u32) -> BitMask {
    BitMask::from_fn(mask.width(), mask.height(), |x, y| disc(mask, x, y, radius).any(|is_set| is_set))
}

/// Every pixel with no pixel within the radius that is not set.
fn shrunk(mask: &BitMask, radius: u32) -> BitMask {
    BitMask::from_fn(mask.width(), mask.height(), |x, y| disc(mask, x, y, radius).all(|is_set| is_set))
}

/// The pixels of the picture within the radius of one.
fn disc(mask: &BitMask, x: u32, y: u32, radius: u32) -> impl Iterator<Item = bool> {
    let rows = y.saturating_sub(radius)..(y + radius + 1).min(mask.height());
    let columns = x.saturating_sub(radius)..(x + radius + 1).min(mask.width());
    let places = rows.flat_map(move |row| columns.clone().map(move |column| (column, row)));
    let is_near = move |column: u32, row: u32| {
        let (across, down) = (column.abs_diff(x), row.abs_diff(y));
        across * across + down * down <= radius * radius
    };
    places.filter(move |(column, row)| is_near(*column, *row)).map(move |(column, row)| mask.get(column, row))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn drawn(rows: &[&str]) -> BitMask {
        let is_set = |x: u32, y: u32| rows[y as usize].as_bytes()[x as usize] == b'#';
        BitMask::from_fn(rows[0].len() as u32, rows.len() as u32, is_set)
    }

    #[test]
    fn opening_takes_out_specks_and_keeps_what_is_large() {
        let mask = drawn(&["#......", "...###.", "..#####", "...###.", "....#..", "##....."]);
        let kept = drawn(&[".......", "...###.", "..#####", "...###.", "....#..", "......."]);
        assert_eq!(opened(&mask, 1), kept);
        assert_eq!(opened(&mask, 0), mask);
    }

    #[test]
    fn closing_fills_holes_and_keeps_what_is_far() {
        let mask = drawn(&["#####..", "##.##..", "#####..", ".......", ".......", "......#"]);
        let filled = drawn(&["#####..", "#####..", "#####..", ".......", ".......", "......#"]);
        assert_eq!(closed(&mask, 1), filled);
        assert_eq!(closed(&BitMask::new(3, 2), 2).count(), 0);
    }
}
