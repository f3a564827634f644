//! Which photos one call of COLMAP's extractor reads, and what it is told of their camera.

use crate::cameras::Group;
use scene_io::Size;

/// Photos of one camera from which a second distortion coefficient is estimated: fewer cannot hold it.
const ENOUGH_FOR_TWO: usize = 20;

/// Pictures that one call of the extractor reads.
pub(crate) struct Batch<'a> {
    pub(crate) names: Vec<&'a str>,
    /// The camera of all of them; `None`: each its own, of which nothing is known.
    group: Option<&'a Group>,
    pub(crate) is_shared: bool,
}

impl Batch<'_> {
    /// COLMAP's name of the lens, and the parameters to begin with where they are known.
    pub(crate) fn camera(&self) -> (&'static str, Option<String>) {
        let (model, zeros) = match self.names.len() {
            ENOUGH_FOR_TWO.. if self.is_shared => ("RADIAL", ",0,0"),
            _ => ("SIMPLE_RADIAL", ",0"),
        };
        let known = self.group.and_then(|group| Some((group.focal?, group.size)));
        let parameters = known.map(|(focal, Size { width, height })| {
            format!("{focal:.3},{},{}{zeros}", f64::from(width) / 2.0, f64::from(height) / 2.0)
        });
        (model, parameters)
    }
}

/// A batch for each camera, and one for all photos that nothing is known of.
pub(crate) fn batches(groups: &[Group]) -> Vec<Batch<'_>> {
    let (alone, shared): (Vec<&Group>, Vec<&Group>) =
        groups.iter().partition(|g| g.names.len() == 1 && g.focal.is_none());
    let mut batches: Vec<Batch<'_>> = shared
        .into_iter()
        .map(|group| Batch {
            names: group.names.iter().map(String::as_str).collect(),
            group: Some(group),
            is_shared: true,
        })
        .collect();
    if !alone.is_empty() {
        let names = alone.iter().flat_map(|g| g.names.iter().map(String::as_str)).collect();
        batches.push(Batch { names, group: None, is_shared: false });
    }
    batches
}

#[cfg(test)]
mod tests {
    use super::*;

    fn group(names: &[&str], focal: Option<f64>) -> Group {
        Group { names: names.iter().map(|n| n.to_string()).collect(), size: Size::new(400, 300), focal }
    }

    #[test]
    fn photos_of_one_camera_are_read_together_with_what_is_known_of_it() {
        let many: Vec<String> = (0..30).map(|i| format!("{i}.jpg")).collect();
        let many: Vec<&str> = many.iter().map(String::as_str).collect();
        let groups = [group(&["a", "b"], Some(350.0)), group(&["c"], None), group(&many, None), group(&["d"], None)];
        let batches = batches(&groups);
        let shapes: Vec<(usize, bool)> = batches.iter().map(|b| (b.names.len(), b.is_shared)).collect();
        assert_eq!(shapes, [(2, true), (30, true), (2, false)]);
        assert_eq!(batches[0].camera(), ("SIMPLE_RADIAL", Some("350.000,200,150,0".into())));
        assert_eq!(batches[1].camera(), ("RADIAL", None));
        assert_eq!(batches[2].names, ["c", "d"]);
    }
}
