//! Lists of names in messages.

/// A list of names for people, the middle of long ones left out.
pub(crate) fn listing(names: &[&str]) -> String {
    const MOST: usize = 20;
    if names.len() <= MOST {
        return names.join(", ");
    }
    format!("{}, … {} more …, {}", names[..MOST - 1].join(", "), names.len() - MOST, names[names.len() - 1])
}
