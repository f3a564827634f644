//! What moves, and how, as other programs see it: optical flow to the neighbouring photos, disparity, motion masks.

use super::flow::Flow;
use crate::bit_mask::{BitMask, nearest};
use std::path::{Component, Path, PathBuf};

/// Folders of optical flow; the second one is NSFF's.
const FLOW: [&str; 2] = ["flow", "flow_i1"];
/// Folders of disparity: MiDaS, DPT.
const DISPARITY: [&str; 2] = ["disp", "dpt"];
/// Folders of motion masks; the second one is RoDynRF's.
const MOTION: [&str; 2] = ["motion_masks", "epipolar_error_png"];

/// Files about motion that belong to a photo. See the table of [`Priors`](crate::Priors)' module for names and forms.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct MotionFiles {
    /// Optical flow to the next photo.
    pub forward: Option<PathBuf>,
    /// Optical flow to the photo before.
    pub backward: Option<PathBuf>,
    /// Disparity of a network that sees one photo: inverse depth up to a factor and a shift, larger = nearer.
    pub disparity: Option<PathBuf>,
    /// White where something moves.
    pub mask: Option<PathBuf>,
}

impl MotionFiles {
    /// Folder in the dataset's own that `nerf-dynamic priors` writes into: folders of the known names are in it, and in these the photos' own
    /// folders where two photos have one name.
    pub const MADE: &'static str = "priors";

    /// The files in folders of the known names beside the photo or beside its folder, but never outside of `root`, the dataset's own; then
    /// those in [`MotionFiles::MADE`].
    #[must_use]
    pub fn beside(photo: &Path, root: &Path) -> Self {
        let Some(stem) = photo.file_stem().and_then(|stem| stem.to_str()) else { return Self::default() };
        let own = photo.parent().into_iter().flat_map(|folder| folder.ancestors().take(2));
        let places: Vec<&Path> = own.filter(|place| within(place, root).is_some()).collect();
        let (made, own) = (root.join(Self::MADE), photo.parent().and_then(|parent| within(parent, root)));
        Self::of(stem, |folders| {
            let beside = places.iter().flat_map(|place| folders.iter().map(move |folder| place.join(folder)));
            let made = folders.iter().flat_map(|folder| in_folder(made.join(folder), own));
            beside.chain(made).collect()
        })
    }

    /// The files in folders of the known names in `folder`, of a photo that has the path `photo`, without the ending of its file, in the
    /// dataset's own: in the photo's own folders there first, as in [`MotionFiles::MADE`].
    #[must_use]
    pub(crate) fn within(folder: &Path, photo: &Path) -> Self {
        let Some(stem) = photo.file_name().and_then(|stem| stem.to_str()) else { return Self::default() };
        // Nothing in a name leads out of the folder.
        let own: PathBuf = photo.parent().into_iter().flat_map(Path::components).filter(is_normal).collect();
        Self::of(stem, |folders| folders.iter().flat_map(|name| in_folder(folder.join(name), Some(&own))).collect())
    }

    /// The first file of each kind of the photo `stem`, in the folders where `places` looks for those of some names.
    fn of(stem: &str, places: impl Fn(&[&str]) -> Vec<PathBuf>) -> Self {
        let stems = spellings(stem);
        let find = |folders: &[&str], endings: &[&str]| {
            places(folders).into_iter().filter(|folder| folder.is_dir()).find_map(|folder| {
                let names = stems.iter().flat_map(|stem| endings.iter().map(move |ending| format!("{stem}{ending}")));
                names.map(|name| folder.join(name)).find(|file| file.is_file())
            })
        };
        Self {
            // A name without direction is taken for `.flo` alone: drawn scenes keep exact flow, which is for scoring, as `.npy`.
            forward: find(&FLOW, &["_fwd.flo", "_fwd.npz", "_fwd.npy", ".flo"]),
            backward: find(&FLOW, &["_bwd.flo", "_bwd.npz", "_bwd.npy"]),
            disparity: find(&DISPARITY, &[".npy", ".png"]),
            mask: find(&MOTION, &[".png"]),
        }
    }
}

/// A folder's path from the dataset's own; `None` outside of it.
fn within<'p>(folder: &'p Path, root: &Path) -> Option<&'p Path> {
    let way = folder.strip_prefix(root).ok()?;
    way.components().all(|part| is_normal(&part)).then_some(way)
}

fn is_normal(part: &Component<'_>) -> bool {
    matches!(part, Component::Normal(_))
}

/// Where a folder of all photos may hold files of one, whose `own` folders are those: in these, then in itself.
fn in_folder(all: PathBuf, own: Option<&Path>) -> impl Iterator<Item = PathBuf> {
    let own = own.map(|own| all.join(own));
    own.into_iter().chain([all])
}

/// A photo's name without extension, and where that is a number the same with as many digits as releases write: 3, 4, 5.
fn spellings(stem: &str) -> Vec<String> {
    let mut all = vec![stem.to_owned()];
    if let Some(number) = stem.parse::<u32>().ok().filter(|_| stem.bytes().all(|b| b.is_ascii_digit())) {
        all.extend([3, 4, 5].map(|digits| format!("{number:0digits$}")));
    }
    all
}

/// Optical flow from a photo to its neighbours, each at its file's own size; see [`Flow`], whose mask says where it is valid.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FlowPrior {
    /// To the next photo; the last one of a sequence has none.
    pub forward: Option<Flow>,
    /// To the photo before; the first one has none.
    pub backward: Option<Flow>,
}

impl FlowPrior {
    /// Both for pictures of another size, see [`Flow::resized`]: vectors are scaled with the columns and the rows, each by its own.
    ///
    /// # Panics
    /// As [`Flow::resized`].
    #[must_use]
    pub fn resized(&self, width: u32, height: u32) -> Self {
        let resized = |flow: &Option<Flow>| flow.as_ref().map(|flow| flow.resized(width, height));
        Self { forward: resized(&self.forward), backward: resized(&self.backward) }
    }
}

/// Inverse depth up to a factor and a shift that nobody knows: it says what is nearer, and how shapes bend.
#[derive(Clone, Debug, PartialEq)]
pub struct Disparity {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// `[height * width]`, no unit, larger = nearer; 0 where it is not known.
    pub values: Vec<f32>,
    /// Where it is known.
    pub known: BitMask,
}

impl Disparity {
    /// A disparity of which values that are not finite are not known; `None` if there are not `width * height` values.
    #[must_use]
    pub fn new(width: u32, height: u32, mut values: Vec<f32>) -> Option<Self> {
        if values.len() as u64 != u64::from(width) * u64::from(height) {
            return None;
        }
        let at = |x: u32, y: u32| y as usize * width as usize + x as usize;
        let known = BitMask::from_fn(width, height, |x, y| values[at(x, y)].is_finite());
        values.iter_mut().filter(|value| !value.is_finite()).for_each(|value| *value = 0.0);
        Some(Self { width, height, values, known })
    }

    /// Smallest and largest value that is known; `None` where none is.
    #[must_use]
    pub fn range(&self) -> Option<[f32; 2]> {
        let known = self.values.iter().zip(self.known.iter()).filter(|(_, known)| *known);
        known.fold(None, |range, (&value, _)| {
            let [low, high] = range.unwrap_or([value, value]);
            Some([value.min(low), value.max(high)])
        })
    }

    /// The same at another size, each pixel as the one that its centre falls into: values of two surfaces are never mixed.
    ///
    /// # Panics
    /// If `values` or `known` is smaller than the size says, or the disparity is empty and the new size is not.
    #[must_use]
    pub fn resized(&self, width: u32, height: u32) -> Self {
        let columns: Vec<usize> = (0..width).map(|x| nearest(x, width, self.width) as usize).collect();
        let row = |y| nearest(y, height, self.height) as usize * self.width as usize;
        let values = (0..height).flat_map(|y| columns.iter().map(move |x| row(y) + x)).map(|at| self.values[at]);
        Self { width, height, values: values.collect(), known: self.known.resized(width, height) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_found_with_any_usual_number_of_digits() {
        assert_eq!(spellings("0007"), ["0007", "007", "0007", "00007"]);
        assert_eq!(spellings("r_7"), ["r_7"]);
        assert_eq!(spellings("+7"), ["+7"]);
    }

    #[test]
    fn files_are_found_beside_the_folder_of_photos_and_not_outside_of_the_dataset() {
        let outside = tempfile::tempdir().unwrap();
        let root = outside.path().join("scene");
        let touch = |name: &str| {
            let path = outside.path().join(name);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(&path, "").unwrap();
            path
        };
        let photo = touch("scene/images/0003.png");
        assert_eq!(MotionFiles::beside(&photo, &root), MotionFiles::default());
        // Exact flow of a drawn scene, and flow of another dataset.
        touch("scene/flow/0003.npy");
        touch("flow/003_fwd.npz");
        assert_eq!(MotionFiles::beside(&photo, &root), MotionFiles::default());
        let forward = touch("scene/flow/003_fwd.npz");
        let backward = touch("scene/flow_i1/00003_bwd.npz");
        let disparity = touch("scene/disp/0003.npy");
        let mask = touch("scene/images/motion_masks/0003.png");
        let found = MotionFiles::beside(&photo, &root);
        let want = [forward, backward, disparity, mask].map(Some);
        assert_eq!([found.forward, found.backward, found.disparity, found.mask], want);
        // Photos that lie in the dataset's own folder.
        let bare = touch("scene/0003.png");
        assert!(MotionFiles::beside(&bare, &root).forward.is_some());
        assert_eq!(MotionFiles::beside(&bare, &root.join("images")), MotionFiles::default());
        // What was made here comes last, and of a photo's own folder first.
        let other = touch("scene/more/9.png");
        let all = touch("scene/priors/motion_masks/9.png");
        assert_eq!(MotionFiles::beside(&other, &root).mask, Some(all));
        let own = touch("scene/priors/motion_masks/more/9.png");
        assert_eq!(MotionFiles::beside(&other, &root).mask, Some(own));
        let beside = touch("scene/motion_masks/9.png");
        assert_eq!(MotionFiles::beside(&other, &root).mask, Some(beside));
    }

    #[test]
    fn disparity_that_is_not_finite_is_not_known() {
        assert_eq!(Disparity::new(2, 2, vec![0.0; 3]), None);
        let disparity = Disparity::new(2, 2, vec![f32::NAN, -3.0, 5.0, f32::INFINITY]).unwrap();
        assert_eq!((disparity.values.as_slice(), disparity.known.count()), (&[0.0, -3.0, 5.0, 0.0][..], 2));
        assert_eq!(disparity.range(), Some([-3.0, 5.0]));
        let large = disparity.resized(4, 4);
        assert_eq!((large.values[3], large.known.get(3, 0), large.known.get(0, 0)), (-3.0, true, false));
        assert_eq!(large.resized(2, 2), disparity);
        assert_eq!(Disparity::new(1, 1, vec![f32::NAN]).unwrap().range(), None);
    }

    #[test]
    fn flow_is_scaled_with_the_columns_and_the_rows_each_by_its_own() {
        let seen = BitMask::from_fn(4, 4, |_, _| true);
        let flow = Flow { width: 4, height: 4, vectors: vec![[8.0, -4.0]; 16], seen };
        let prior = FlowPrior { forward: Some(flow), backward: None };
        let small = prior.resized(2, 1);
        assert_eq!(small.forward.unwrap().vectors, [[4.0, -1.0]; 2]);
        assert_eq!(small.backward, None);
    }
}
