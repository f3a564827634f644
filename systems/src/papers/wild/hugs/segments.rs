//! The segments that vote on masks, and the static features that structure from motion knows.

use engine::system::SystemError;
use losses::LossError;
use losses::heuristics::points::{disc_radius, discs, segments_at, union};
use losses::heuristics::superpixels::Superpixels;
use losses::heuristics::{Extent, Segments, VoteScratch, vote};
use scene_io::Frame;

/// Least score and stability of a segment around a feature point, where the segmenter gave them.
const LEAST_SCORE: f32 = 0.8;
const LEAST_STABILITY: f32 = 0.92;

/// Segments of a photo.
pub(super) enum Pieces {
    Pixels,
    Labels(Vec<u16>),
    Stack(Vec<Vec<u8>>),
}

impl Pieces {
    /// Superpixels of a photo, `[pixels]`.
    pub(super) fn superpixels(
        superpixels: Superpixels,
        extent: Extent,
        photo: &[[f32; 3]],
    ) -> Result<Self, SystemError> {
        let mut labels = vec![0; extent.pixels()];
        superpixels.run(extent, photo, &mut labels).map_err(|e| refused("superpixels", superpixels.count, &e))?;
        Ok(Self::Labels(labels))
    }

    /// Segments from a file, of the size that is compared.
    pub(super) fn from_file(segments: scene_io::Segments) -> Self {
        match segments {
            scene_io::Segments::Labels(map) => Self::Labels(map.labels),
            scene_io::Segments::Stack(masks) => {
                Self::Stack(masks.iter().map(|m| m.iter().map(u8::from).collect()).collect())
            }
        }
    }

    /// A segment is static as a whole from the share `share` of static pixels on, and not at all below.
    pub(super) fn vote(&self, extent: Extent, bits: &[u8], share: f32, votes: &mut VoteScratch) -> Vec<u8> {
        let stack: Vec<&[u8]>;
        let segments = match self {
            Self::Pixels => Segments::Pixels,
            Self::Labels(labels) => Segments::Labels(labels),
            Self::Stack(masks) => {
                stack = masks.iter().map(|m| &m[..]).collect();
                Segments::Stack(&stack)
            }
        };
        let mut voted = vec![0; extent.pixels()];
        let fits = "a bit for each square, and the settings are checked before";
        vote(extent, segments, bits, share, votes, &mut voted).expect(fits);
        voted
    }
}

/// A setting of which no segments can be made.
pub(super) fn refused(field: &'static str, value: impl ToString, e: &LossError) -> SystemError {
    SystemError::Config { field, value: value.to_string(), problem: e.to_string() }
}

/// The heuristic of structure from motion, `H_SfM`: segments around features that at least `min_track` photos share.
pub(super) fn shared_features(
    frame: &Frame,
    min_track: u32,
    extent: Extent,
    segments: Option<&scene_io::Segments>,
) -> Result<Vec<u8>, SystemError> {
    let (width, height) = (extent.width as u32, extent.height as u32);
    let scale = [width as f32 / frame.camera.width as f32, height as f32 / frame.camera.height as f32];
    let points: Vec<[f32; 2]> = frame
        .tracks
        .iter()
        .filter(|track| track.length >= min_track)
        .map(|track| [track.pixel[0] * scale[0], track.pixel[1] * scale[1]])
        .collect();
    let mut out = vec![0; extent.pixels()];
    let bytes = |mask: &scene_io::BitMask| mask.resized(width, height).iter().map(u8::from).collect::<Vec<u8>>();
    let made = if let Some(prompted) = frame.read_prompted()? {
        let sure = |s: &scene_io::PromptedSegment| {
            s.score.is_none_or(|s| s > LEAST_SCORE) && s.stability.is_none_or(|s| s >= LEAST_STABILITY)
        };
        let stack: Vec<Vec<u8>> = prompted.iter().filter(|s| sure(s)).map(|s| bytes(&s.mask)).collect();
        union(extent, &stack.iter().map(|m| &m[..]).collect::<Vec<_>>(), &mut out)
    } else {
        match segments {
            Some(scene_io::Segments::Labels(map)) => segments_at(extent, &map.labels, &points, &mut out),
            Some(scene_io::Segments::Stack(masks)) => {
                let at = |p: &[f32; 2]| [p[0] as u32, p[1] as u32];
                let inside = |m: &&scene_io::BitMask| {
                    points.iter().map(at).any(|[x, y]| x < m.width() && y < m.height() && m.get(x, y))
                };
                let stack: Vec<Vec<u8>> = masks.iter().filter(inside).map(bytes).collect();
                union(extent, &stack.iter().map(|m| &m[..]).collect::<Vec<_>>(), &mut out)
            }
            None => discs(extent, &points, disc_radius(extent), &mut out),
        }
    };
    made.map_err(|e| refused("track_share", format!("at least {min_track} photos"), &e))?;
    Ok(out)
}
