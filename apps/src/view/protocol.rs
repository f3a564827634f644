//! What page and server say to each other.
//!
//! The page sends JSON texts, [`Message`]; the server answers with JSON texts (`scene`, `training`, `waiting`, `picked`,
//! `error`) and with pictures, which are binary: a [`Header`] and then a JPEG or PNG file.

use glam::{DMat3, DQuat, DVec3};
use render_core::camera::{Camera, Pose};
use serde::Deserialize;
use systems::crop::Crop;

/// Bytes a message of the page may have: many times what any needs.
pub(crate) const LARGEST_MESSAGE: usize = 16 << 10;

/// Pixels a side of a picture may have.
const LARGEST_SIDE: u32 = 4096;

/// What a page asks.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(tag = "type", rename_all = "lowercase")]
pub(crate) enum Message {
    /// A picture, now and then better ones, until the next message of this kind.
    Draw(Draw),
    /// Which point of the scene is seen.
    Pick(Pick),
    /// Keep a crop beside what is shown, for `export`.
    Save {
        /// What is kept of the scene.
        crop: Crop,
    },
}

/// A picture that is wanted.
#[derive(Clone, Debug, PartialEq, Deserialize)]
pub(crate) struct Draw {
    /// Comes back with the picture.
    pub(crate) id: u32,
    #[serde(flatten)]
    pub(crate) eye: Eye,
    /// What the picture shows.
    pub(crate) layer: Layer,
    /// Longest side of the best picture, pixels.
    pub(crate) limit: u32,
    /// Time of a scene that moves, `0..=1`.
    #[serde(default)]
    pub(crate) time: f64,
    /// In which light, where there are several.
    #[serde(default)]
    pub(crate) light: Light,
    /// What is behind the scene, `0..=1` each; without, as it was trained.
    #[serde(default)]
    pub(crate) background: Option<[f32; 3]>,
    /// The photo meant by the layers `photo`, `mask` and `uncertainty`: an index into the scene's photos.
    #[serde(default)]
    pub(crate) photo: Option<usize>,
    /// What of the scene is drawn.
    #[serde(default)]
    pub(crate) crop: Crop,
}

/// A point that is wanted.
#[derive(Clone, Debug, PartialEq, Deserialize)]
pub(crate) struct Pick {
    /// Comes back with the point.
    pub(crate) id: u32,
    #[serde(flatten)]
    pub(crate) eye: Eye,
    /// Place in the picture, `0..=1`, from the left and from the top.
    pub(crate) at: [f64; 2],
    /// As in [`Draw`].
    #[serde(default)]
    pub(crate) time: f64,
}

/// From where, and how large the place is that the picture is for.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
pub(crate) struct Eye {
    /// Columns there are, pixels.
    pub(crate) width: u32,
    /// Rows there are, pixels.
    pub(crate) height: u32,
    /// Centre of the camera, world units.
    pub(crate) position: [f64; 3],
    /// Camera-to-world rotation, CV axes, w first.
    pub(crate) wxyz: [f64; 4],
    /// Angle from the upper to the lower edge, radians.
    pub(crate) fov: f64,
}

/// What a picture shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum Layer {
    Colour,
    Depth,
    Opacity,
    Normals,
    Canonical,
    /// A photo of the scene, as it was taken.
    Photo,
    /// What of a photo shows the place itself, as the system sees it.
    Mask,
    /// How far a photo may be from the place, as the system sees it.
    Uncertainty,
}

impl Layer {
    pub(crate) const COUNT: usize = 8;

    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Colour => "colour",
            Self::Depth => "depth",
            Self::Opacity => "opacity",
            Self::Normals => "normals",
            Self::Canonical => "canonical",
            Self::Photo => "photo",
            Self::Mask => "mask",
            Self::Uncertainty => "uncertainty",
        }
    }

    /// Whether it is of a photo, not of the scene from anywhere.
    pub(crate) fn is_of_photo(self) -> bool {
        matches!(self, Self::Photo | Self::Mask | Self::Uncertainty)
    }
}

/// A mix of the lights of two photos; `None` is the mean of all.
#[derive(Clone, Copy, Debug, Default, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct Light {
    /// The light at blend 0, an index into the scene's lights.
    pub(crate) from: Option<usize>,
    /// The light at blend 1.
    pub(crate) to: Option<usize>,
    /// How far from one to the other, `0..=1`.
    pub(crate) blend: f32,
}

impl Message {
    /// Read a message and check its numbers.
    ///
    /// # Errors
    /// A sentence that names what is wrong.
    pub(crate) fn parse(text: &str) -> Result<Self, String> {
        let message: Self = serde_json::from_str(text).map_err(|e| format!("the message is not understood: {e}"))?;
        match &message {
            Self::Draw(draw) => draw.check()?,
            Self::Pick(pick) => pick.check()?,
            Self::Save { crop } => crop.check()?,
        }
        Ok(message)
    }
}

fn within(field: &str, value: f64, range: std::ops::RangeInclusive<f64>) -> Result<(), String> {
    match range.contains(&value) {
        true => Ok(()),
        false => Err(format!("`{field}` = {value}: write a number from {} to {}", range.start(), range.end())),
    }
}

impl Draw {
    fn check(&self) -> Result<(), String> {
        self.eye.check()?;
        within("limit", f64::from(self.limit), 16.0..=f64::from(LARGEST_SIDE))?;
        within("time", self.time, 0.0..=1.0)?;
        within("light.blend", f64::from(self.light.blend), 0.0..=1.0)?;
        for value in self.background.into_iter().flatten() {
            within("background", f64::from(value), 0.0..=1.0)?;
        }
        self.crop.check()
    }

    /// Size of the best picture.
    pub(crate) fn full_size(&self) -> (u32, u32) {
        super::pace::scaled((self.eye.width, self.eye.height), self.limit)
    }
}

impl Pick {
    fn check(&self) -> Result<(), String> {
        self.eye.check()?;
        within("time", self.time, 0.0..=1.0)?;
        self.at.into_iter().try_for_each(|x| within("at", x, 0.0..=1.0))
    }

    /// A camera of one pixel that looks where the pick is.
    pub(crate) fn camera(&self) -> Camera {
        let camera = self.eye.camera((self.eye.width, self.eye.height));
        let [x, y] = [self.at[0] * f64::from(camera.width), self.at[1] * f64::from(camera.height)];
        Camera { width: 1, height: 1, cx: camera.cx - x + 0.5, cy: camera.cy - y + 0.5, ..camera }
    }
}

impl Eye {
    fn check(&self) -> Result<(), String> {
        const FAR: f64 = 1e9;
        within("width", f64::from(self.width), 1.0..=f64::from(LARGEST_SIDE))?;
        within("height", f64::from(self.height), 1.0..=f64::from(LARGEST_SIDE))?;
        within("fov", self.fov, 0.01..=3.0)?;
        self.position.into_iter().try_for_each(|x| within("position", x, -FAR..=FAR))?;
        self.wxyz.into_iter().try_for_each(|x| within("wxyz", x, -2.0..=2.0))?;
        let length = self.wxyz.iter().map(|x| x * x).sum::<f64>().sqrt();
        within("length of wxyz", length, 0.5..=2.0)
    }

    /// The camera of a picture of `width` x `height` pixels.
    pub(crate) fn camera(&self, (width, height): (u32, u32)) -> Camera {
        let [w, x, y, z] = self.wxyz;
        let r = DMat3::from_quat(DQuat::from_xyzw(x, y, z, w).normalize());
        let pose = Pose { r, c: DVec3::from_array(self.position) };
        let (w, h) = (f64::from(width), f64::from(height));
        let fy = 0.5 * h / (0.5 * self.fov).tan();
        // Pixels are as wide as high where the picture is shown; its own sides are rounded.
        let fx = fy * (w / h) / (f64::from(self.width) / f64::from(self.height));
        Camera::pinhole(width, height, fx, fy, w / 2.0, h / 2.0, pose)
    }
}

/// How good a picture is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Quality {
    /// Drawn in time; better ones follow if the camera rests.
    Quick = 0,
    /// Between.
    Better = 1,
    /// As good as asked for.
    Full = 2,
}

/// What drew a picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Drawer {
    /// The scene itself.
    Scene = 0,
    /// The cloud that stands for a field.
    Cloud = 1,
    /// The scene above, the cloud below: a picture that is not finished.
    Both = 2,
}

/// What stands before the bytes of a picture, little endian, in this order.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Header {
    /// Of the request, `u32`.
    pub(crate) id: u32,
    /// Training steps of what is shown, `u32`.
    pub(crate) step: u32,
    /// Milliseconds to draw and encode it, `f32`.
    pub(crate) ms: f32,
    /// Depths that are drawn brightest and darkest, world units, two `f32`; 0 in other layers.
    pub(crate) depths: [f32; 2],
    /// Columns and rows, two `u16`.
    pub(crate) size: (u16, u16),
    /// One byte.
    pub(crate) quality: Quality,
    /// One byte; two more are 0.
    pub(crate) drawer: Drawer,
}

impl Header {
    pub(crate) const BYTES: usize = 28;

    /// The message: this header, and then the file.
    pub(crate) fn before(&self, file: &[u8]) -> Vec<u8> {
        let mut out = Vec::with_capacity(Self::BYTES + file.len());
        out.extend(self.id.to_le_bytes());
        out.extend(self.step.to_le_bytes());
        out.extend(self.ms.to_le_bytes());
        out.extend(self.depths[0].to_le_bytes());
        out.extend(self.depths[1].to_le_bytes());
        out.extend(self.size.0.to_le_bytes());
        out.extend(self.size.1.to_le_bytes());
        out.extend([self.quality as u8, self.drawer as u8, 0, 0]);
        out.extend(file);
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec2;

    const EYE: &str = r#""width": 80, "height": 60, "position": [1, 2, 3], "wxyz": [1, 0, 0, 0], "fov": 1.5"#;

    fn parse(text: &str) -> Result<Message, String> {
        Message::parse(&text.replace("EYE", EYE))
    }

    #[test]
    fn messages_of_the_page_are_understood() {
        let text = r#"{"type": "draw", "id": 7, EYE, "layer": "depth", "limit": 40, "time": 0.5,
                       "light": {"from": 3, "blend": 0.25}, "background": [1, 0, 0]}"#;
        let Ok(Message::Draw(draw)) = parse(text) else { panic!("{:?}", parse(text)) };
        assert_eq!((draw.id, draw.layer, draw.full_size()), (7, Layer::Depth, (40, 30)));
        assert_eq!(draw.light, Light { from: Some(3), to: None, blend: 0.25 });
        let short = r#"{"type": "draw", "id": 7, EYE, "layer": "mask", "limit": 4000, "photo": 2}"#;
        let Ok(Message::Draw(draw)) = parse(short) else { panic!("{:?}", parse(short)) };
        assert_eq!((draw.full_size(), draw.photo, draw.background), ((80, 60), Some(2), None));
        assert!(matches!(parse(r#"{"type": "pick", "id": 1, EYE, "at": [0, 1]}"#), Ok(Message::Pick(_))));
    }

    #[test]
    fn what_is_wrong_with_a_message_is_named() {
        let draw = |extra: &str| format!(r#"{{"type": "draw", "id": 1, EYE, "layer": "colour", "limit": 40{extra}}}"#);
        for (text, part) in [
            ("", "EOF"),
            ("[]", "not understood"),
            ("{}", "type"),
            (r#"{"type": "delete"}"#, "delete"),
            (r#"{"type": "draw"}"#, "id"),
            (&draw(r#", "time": 1.5"#), "`time` = 1.5"),
            (&draw(r#", "time": "now""#), "not understood"),
            (&draw(r#", "background": [0, 0, 2]"#), "`background` = 2"),
            (&draw(r#", "light": {"blend": -1}"#), "`light.blend` = -1"),
            (&draw(r#", "photo": -1"#), "not understood"),
            (&draw("").replace("colour", "smell"), "smell"),
            (&draw("").replace("\"limit\": 40", "\"limit\": 1000000"), "`limit`"),
            (&draw("").replace("EYE", &EYE.replace("80", "0")), "`width` = 0"),
            (&draw("").replace("EYE", &EYE.replace("1.5", "3.2")), "`fov` = 3.2"),
            (&draw("").replace("EYE", &EYE.replace("[1, 0", "[0, 0")), "wxyz"),
            (&draw("").replace("EYE", &EYE.replace("[1, 2", "[1e99, 2")), "`position`"),
            (r#"{"type": "pick", "id": 1, EYE, "at": [0, 7]}"#, "`at` = 7"),
            (&draw(r#", "crop": {"faint": 2}"#), "`faint` = 2"),
            (&draw(r#", "crop": {"path": "/etc/passwd"}"#), "not understood"),
            (r#"{"type": "save"}"#, "crop"),
            (r#"{"type": "save", "crop": {"box": [[0, 0, 0], [0, 0, 0]]}}"#, "`box`"),
        ] {
            let error = parse(text).unwrap_err();
            assert!(error.contains(part), "{text}: {error}");
        }
    }

    #[test]
    fn a_camera_sees_the_same_at_every_size() {
        let Ok(Message::Draw(draw)) = parse(r#"{"type": "draw", "id": 1, EYE, "layer": "colour", "limit": 80}"#) else {
            panic!("a good message")
        };
        let camera = draw.eye.camera((80, 60));
        assert!((2.0 * (30.0 / camera.fy).atan() - 1.5).abs() < 1e-12 && (camera.fx - camera.fy).abs() < 1e-9);
        assert_eq!(camera.pose.c, DVec3::new(1.0, 2.0, 3.0));
        for size in [(40, 30), (13, 10), (1, 1)] {
            let other = draw.eye.camera(size);
            let corner = other.ray(DVec2::ZERO).unwrap();
            assert!((corner.d - camera.ray(DVec2::ZERO).unwrap().d).length() < 1e-12, "{size:?}");
        }
    }

    #[test]
    fn a_pick_looks_through_its_place_in_the_picture() {
        let Ok(Message::Pick(pick)) = parse(r#"{"type": "pick", "id": 1, EYE, "at": [0.25, 0.9]}"#) else {
            panic!("a good message")
        };
        let whole = pick.eye.camera((80, 60)).ray(DVec2::new(20.0, 54.0)).unwrap();
        let one = pick.camera().ray(DVec2::splat(0.5)).unwrap();
        assert!((whole.d - one.d).length() < 1e-12 && whole.o == one.o);
    }

    #[test]
    fn a_header_has_its_fields_at_known_places() {
        let header = Header {
            id: 1,
            step: 300,
            ms: 2.5,
            depths: [1.0, 4.0],
            size: (640, 480),
            quality: Quality::Full,
            drawer: Drawer::Both,
        };
        let bytes = header.before(b"file");
        assert_eq!(bytes.len(), Header::BYTES + 4);
        assert_eq!(bytes[..8], [1, 0, 0, 0, 44, 1, 0, 0]);
        assert_eq!(bytes[8..12], 2.5f32.to_le_bytes());
        assert_eq!(bytes[20..28], [128, 2, 224, 1, 2, 2, 0, 0]);
        assert_eq!(&bytes[28..], b"file");
    }
}
