//! Which pictures were taken by one camera: they share its focal length and lens.

use crate::photo::Picture;
use scene_io::Size;
use std::collections::BTreeMap;

/// What to make of photos that do not say which camera took them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum UnknownCameras {
    /// Those of one size were taken by one camera: photos of one person.
    #[default]
    Shared,
    /// Each was taken by another: photos by many people.
    Each,
}

/// Longest sides that a focal length is guessed to have where it is not known: what COLMAP takes, too.
pub(crate) const GUESSED_FOCAL: f64 = 1.2;

/// Pictures of one camera.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Group {
    /// Names, in order.
    pub(crate) names: Vec<String>,
    pub(crate) size: Size,
    /// Focal length, pixels, where the photos say it.
    pub(crate) focal: Option<f64>,
}

impl Group {
    /// All of it as text for the marker of a stage. Markers lie in folders that were prepared before: another text would have
    /// their work done again.
    pub(crate) fn marker(&self) -> String {
        let Self { names, size, focal } = self;
        format!("Group {{ names: {names:?}, size: ({}, {}), focal: {focal:?} }}", size.width, size.height)
    }

    /// Focal length to begin with, pixels.
    #[cfg_attr(not(feature = "sfm"), expect(dead_code, reason = "COLMAP makes the same guess by itself"))]
    pub(crate) fn first_focal(&self) -> f64 {
        self.focal.unwrap_or(GUESSED_FOCAL * f64::from(self.size.longest_side()))
    }
}

/// Groups by device, size and focal length (to about 1 %: zoom lenses), in the order of their first pictures.
pub(crate) fn groups(pictures: &[Picture], unknown: UnknownCameras) -> Vec<Group> {
    type Key = (String, (u32, u32), Option<i64>, usize);
    let mut found: BTreeMap<Key, usize> = BTreeMap::new();
    let mut groups: Vec<Group> = Vec::new();
    for (i, picture) in pictures.iter().enumerate() {
        let is_unknown = picture.device.is_empty() && picture.focal.is_none();
        let alone = if is_unknown && unknown == UnknownCameras::Each { i + 1 } else { 0 };
        let focal = picture.focal.map(|f| (f.max(1.0).ln() * 100.0).round() as i64);
        let key = (picture.device.clone(), picture.size, focal, alone);
        let at = *found.entry(key).or_insert_with(|| {
            groups.push(Group { names: Vec::new(), size: picture.size.into(), focal: picture.focal });
            groups.len() - 1
        });
        groups[at].names.push(picture.name.clone());
    }
    groups
}

#[cfg(test)]
mod tests {
    use super::*;

    fn picture(name: &str, device: &str, size: (u32, u32), focal: Option<f64>) -> Picture {
        Picture { name: name.into(), source: name.into(), size, device: device.into(), focal }
    }

    #[test]
    fn markers_stay_as_they_were() {
        let group = |focal| Group { names: vec!["a".into(), "b\"".into()], size: Size::new(40, 30), focal };
        assert_eq!(group(Some(33.0)).marker(), r#"Group { names: ["a", "b\""], size: (40, 30), focal: Some(33.0) }"#);
        assert_eq!(group(None).marker(), r#"Group { names: ["a", "b\""], size: (40, 30), focal: None }"#);
    }

    #[test]
    fn a_camera_is_a_device_a_size_and_a_focal_length() {
        let pictures = [
            picture("a", "Phone", (40, 30), Some(33.0)),
            picture("b", "Phone", (30, 40), Some(33.0)),
            picture("c", "Phone", (40, 30), Some(33.05)),
            picture("d", "Phone", (40, 30), Some(66.0)),
            picture("e", "", (40, 30), None),
            picture("f", "", (40, 30), None),
        ];
        let names = |unknown| -> Vec<String> { groups(&pictures, unknown).iter().map(|g| g.names.concat()).collect() };
        assert_eq!(names(UnknownCameras::Shared), ["ac", "b", "d", "ef"]);
        assert_eq!(names(UnknownCameras::Each), ["ac", "b", "d", "e", "f"]);
        assert!(groups(&[], UnknownCameras::Shared).is_empty());
    }
}
