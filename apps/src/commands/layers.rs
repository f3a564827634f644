//! The layers of the frames of a path: as pictures, and what their colours mean. Flow also as it is, in files of Middlebury's form.

use crate::cli::{Layer, Render};
use crate::show::line;
use engine::RunError;
use engine::flow::FlowPath;
use engine::output::Disk;
use engine::picture::{self, write_png};
use engine::render::Rendered;
use image::RgbImage;
use scene_io::{Flow, write_flo};
use std::borrow::Cow;

/// Names of the files of each layer.
const NAMES: [(Layer, &str); 7] = [
    (Layer::Colour, "colour"),
    (Layer::Depth, "depth"),
    (Layer::Opacity, "opacity"),
    (Layer::Normals, "normals"),
    (Layer::Canonical, "canonical"),
    (Layer::Flow, "flow"),
    (Layer::Background, "background"),
];

/// What all frames share.
pub(super) struct Scales<'a> {
    /// From the first frame, with room on both sides.
    depth: Option<[f32; 2]>,
    bounds: [[f64; 3]; 2],
    /// Where flow is asked for.
    flow: Option<FlowPath<'a>>,
}

/// The layers of a frame.
pub(super) struct Drawn<'a> {
    view: &'a Rendered,
    colour: RgbImage,
    /// `None` where it is not asked for, and of the last frame.
    flow: Option<DrawnFlow>,
    depth: [f32; 2],
    bounds: [[f64; 3]; 2],
}

/// Flow to the next frame.
struct DrawnFlow {
    flow: Flow,
    picture: RgbImage,
}

impl<'a> Scales<'a> {
    pub(super) fn new(bounds: [[f64; 3]; 2], flow: Option<FlowPath<'a>>) -> Self {
        Self { depth: None, bounds, flow }
    }

    /// Frame `i` of the path, as it was drawn.
    pub(super) fn frame<'v>(&mut self, i: usize, view: &'v Rendered) -> Drawn<'v> {
        let depth = *self.depth.get_or_insert_with(|| {
            let [near, far] = picture::depth_range(&[view]);
            [near * 0.8, far * 1.25]
        });
        let flow = self.flow.as_ref().and_then(|path| {
            let flow = path.flow(i, view)?;
            Some(DrawnFlow { picture: path.picture(&flow), flow })
        });
        Drawn { view, colour: picture::colour(view), flow, depth, bounds: self.bounds }
    }

    /// Say what the colours of the layers mean that have a scale.
    pub(super) fn say(&self, layers: &[Layer]) {
        if let (true, Some([near, far])) = (layers.contains(&Layer::Depth), self.depth) {
            line(format_args!("depth is drawn from {near:.4} (bright) to {far:.4} (dark), world units along the ray"));
        }
        if layers.contains(&Layer::Canonical) {
            let [min, max] = self.bounds;
            line(format_args!(
                "canonical points are drawn from {:.4} {:.4} {:.4} (black) to {:.4} {:.4} {:.4}, world units: x red, y green, z blue",
                min[0], min[1], min[2], max[0], max[1], max[2]
            ));
        }
        self.flow.iter().flat_map(FlowPath::lines).for_each(line);
    }
}

impl Drawn<'_> {
    fn picture(&self, layer: Layer) -> Option<Cow<'_, RgbImage>> {
        Some(match layer {
            Layer::Colour => Cow::Borrowed(&self.colour),
            Layer::Depth => Cow::Owned(picture::depth(self.view, self.depth)),
            Layer::Opacity => Cow::Owned(picture::opacity(self.view)),
            Layer::Normals => Cow::Owned(picture::normals(self.view)),
            Layer::Canonical => Cow::Owned(picture::canonical(self.view, self.bounds)),
            Layer::Flow => Cow::Borrowed(&self.flow.as_ref()?.picture),
            Layer::Background => Cow::Owned(picture::behind(self.view)?),
        })
    }

    /// Write the layers that were asked for, as those of frame `i`.
    pub(super) fn write(&self, args: &Render, i: usize) -> Result<(), RunError> {
        for (layer, name) in NAMES.into_iter().filter(|(layer, _)| args.layers.contains(layer)) {
            let picture = self.picture(layer);
            if layer == Layer::Background && picture.is_none() {
                return Err(RunError::Option(
                    "--layers background: this system does not know what moves from what stands still; `degauss` does"
                        .into(),
                ));
            }
            if let Some(picture) = picture {
                write_png(&Disk, &args.out.join(format!("{name}_{i:04}.png")), &picture)?;
            }
            if let (Layer::Flow, Some(DrawnFlow { flow, .. })) = (layer, &self.flow) {
                write_flo(&args.out.join(format!("{name}_{i:04}.flo")), flow)?;
            }
        }
        Ok(())
    }

    /// The layer that preview and video show: the first one asked for.
    pub(super) fn first(&self, args: &Render) -> Option<RgbImage> {
        let layer = args.layers.first().copied().unwrap_or(Layer::Colour);
        self.picture(layer).map(Cow::into_owned)
    }
}
