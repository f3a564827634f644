//! What page and server say to each other.
//!
//! The page sends JSON texts, [`Message`]; the server answers with JSON texts (`scene`, `training`, `waiting`, `picked`, `saved`,
//! `fast`, `error`) and with pictures, which are binary: a [`Header`](super::header::Header) and then a JPEG or PNG file.
//!
//! Nothing of a message is trusted: [`Message::read`] takes any bytes, and what it lets through has sizes, places and times within
//! the bounds below. Fields that are not known are refused.

use engine::crop::Crop;
use glam::{DMat3, DQuat, DVec3};
use render_core::camera::{Camera, Pose};
use scene_io::Size;
use serde::Deserialize;

/// Bytes a message of the page may have: many times what any needs.
pub(crate) const LARGEST_MESSAGE: usize = 16 << 10;

/// Pixels a side of the place for a picture may have.
const LARGEST_SIDE: u32 = 4096;

/// Pixels the longest side of a picture may have: what the page offers at most.
pub(crate) const LARGEST_PICTURE: u32 = 2400;

/// Characters of a sentence about a wrong message: parts of the message are in it.
const LONGEST_SENTENCE: usize = 300;

/// What a page asks.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(tag = "type", rename_all = "lowercase")]
pub(crate) enum Message {
    /// A picture, now and then better ones, until the next message of this kind.
    Draw(Draw),
    /// Which point of the scene is seen.
    Pick(Pick),
    /// Keep a crop beside what is shown, for `export`.
    Save(Save),
}

/// A crop to be kept.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Save {
    /// What is kept of the scene.
    pub(crate) crop: Crop,
}

/// A picture that is wanted.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(from = "super::wire::Draw")]
pub(crate) struct Draw {
    /// Comes back with the picture.
    pub(crate) id: u32,
    /// The camera.
    pub(crate) eye: Eye,
    /// What the picture shows.
    pub(crate) layer: Layer,
    /// Longest side of the best picture, pixels.
    pub(crate) limit: u32,
    /// Time of a scene that moves, `0..=1`.
    pub(crate) time: f64,
    /// In which appearance, where there are several.
    pub(crate) appearance: AppearanceMix,
    /// What is behind the scene, `0..=1` each; without, as it was trained.
    pub(crate) background: Option<[f32; 3]>,
    /// The photo meant by the layers `photo`, `mask` and `uncertainty`: an index into the scene's photos.
    pub(crate) photo: Option<usize>,
    /// What of the scene is drawn.
    pub(crate) crop: Crop,
}

/// A point that is wanted.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(from = "super::wire::Pick")]
pub(crate) struct Pick {
    /// Comes back with the point.
    pub(crate) id: u32,
    /// The camera.
    pub(crate) eye: Eye,
    /// Place in the picture, `0..=1`, from the left and from the top.
    pub(crate) at: [f64; 2],
    /// As in [`Draw`].
    pub(crate) time: f64,
}

/// From where, and how large the place is that the picture is for.
#[derive(Clone, Copy, Debug, PartialEq)]
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
    /// Where what is seen goes until the next frame, the camera staying where it is.
    Flow,
    /// What stands still, without what moves before it.
    Background,
    /// A photo of the scene, as it was taken.
    Photo,
    /// What of a photo shows the place itself, as the system sees it.
    Mask,
    /// How far a photo may be from the place, as the system sees it.
    Uncertainty,
}

impl Layer {
    pub(crate) const COUNT: usize = 10;

    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Colour => "colour",
            Self::Depth => "depth",
            Self::Opacity => "opacity",
            Self::Normals => "normals",
            Self::Canonical => "canonical",
            Self::Flow => "flow",
            Self::Background => "background",
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

/// A mix of the appearances of two photos; `None` is the mean of all.
#[derive(Clone, Copy, Debug, Default, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct AppearanceMix {
    /// The appearance at blend 0, an index into the scene's appearances.
    pub(crate) from: Option<usize>,
    /// The appearance at blend 1.
    pub(crate) to: Option<usize>,
    /// How far from one to the other, `0..=1`.
    pub(crate) blend: f32,
}

impl Message {
    /// Read a message of any bytes and check its numbers.
    ///
    /// # Errors
    /// One line that names what is wrong, at most [`LONGEST_SENTENCE`] characters.
    pub(crate) fn read(bytes: &[u8]) -> Result<Self, String> {
        Self::checked(bytes).map_err(|problem| {
            // Parts of the message are in the sentence, line breaks and all.
            let line = problem.chars().map(|c| if c.is_control() { ' ' } else { c });
            line.take(LONGEST_SENTENCE).collect()
        })
    }

    fn checked(bytes: &[u8]) -> Result<Self, String> {
        if bytes.len() > LARGEST_MESSAGE {
            return Err(format!("the message has {} bytes: send at most {LARGEST_MESSAGE}", bytes.len()));
        }
        let message: Self = serde_json::from_slice(bytes).map_err(|e| format!("the message is not understood: {e}"))?;
        match &message {
            Self::Draw(draw) => draw.check()?,
            Self::Pick(pick) => pick.check()?,
            Self::Save(Save { crop }) => crop.check()?,
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
        within("limit", f64::from(self.limit), 16.0..=f64::from(LARGEST_PICTURE))?;
        within("time", self.time, 0.0..=1.0)?;
        within("appearance.blend", f64::from(self.appearance.blend), 0.0..=1.0)?;
        for value in self.background.into_iter().flatten() {
            within("background", f64::from(value), 0.0..=1.0)?;
        }
        self.crop.check()
    }

    /// Size of the best picture.
    pub(crate) fn full_size(&self) -> Size {
        super::pace::scaled(Size::new(self.eye.width, self.eye.height), self.limit)
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
        let camera = self.eye.camera(Size::new(self.eye.width, self.eye.height));
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

    /// The camera of a picture of `size`.
    pub(crate) fn camera(&self, size: Size) -> Camera {
        let Size { width, height } = size;
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

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec2;

    const EYE: &str = r#""width": 80, "height": 60, "position": [1, 2, 3], "wxyz": [1, 0, 0, 0], "fov": 1.5"#;

    fn parse(text: &str) -> Result<Message, String> {
        Message::read(text.replace("EYE", EYE).as_bytes())
    }

    #[test]
    fn messages_of_the_page_are_understood() {
        let text = r#"{"type": "draw", "id": 7, EYE, "layer": "depth", "limit": 40, "time": 0.5,
                       "appearance": {"from": 3, "blend": 0.25}, "background": [1, 0, 0]}"#;
        let Ok(Message::Draw(draw)) = parse(text) else { panic!("{:?}", parse(text)) };
        assert_eq!((draw.id, draw.layer, draw.full_size()), (7, Layer::Depth, Size::new(40, 30)));
        assert_eq!(draw.appearance, AppearanceMix { from: Some(3), to: None, blend: 0.25 });
        let short = r#"{"type": "draw", "id": 7, EYE, "layer": "mask", "limit": 2400, "photo": 2}"#;
        let Ok(Message::Draw(draw)) = parse(short) else { panic!("{:?}", parse(short)) };
        assert_eq!((draw.full_size(), draw.photo, draw.background), (Size::new(80, 60), Some(2), None));
        assert!(matches!(parse(r#"{"type": "pick", "id": 1, EYE, "at": [0, 1]}"#), Ok(Message::Pick(_))));
        // The words of layers are those that scenes are described with.
        let all = [
            "colour",
            "depth",
            "opacity",
            "normals",
            "canonical",
            "flow",
            "background",
            "photo",
            "mask",
            "uncertainty",
        ];
        assert_eq!(all.len(), Layer::COUNT);
        for (i, word) in all.into_iter().enumerate() {
            let text = format!(r#"{{"type": "draw", "id": 7, EYE, "layer": "{word}", "limit": 40}}"#);
            let Ok(Message::Draw(draw)) = parse(&text) else { panic!("{:?}", parse(&text)) };
            assert_eq!((draw.layer as usize, draw.layer.name()), (i, word));
        }
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
            (&draw(r#", "appearance": {"blend": -1}"#), "`appearance.blend` = -1"),
            (&draw(r#", "photo": -1"#), "not understood"),
            (&draw("").replace("colour", "smell"), "smell"),
            (&draw("").replace("\"limit\": 40", "\"limit\": 2401"), "`limit` = 2401"),
            (&draw("").replace("\"limit\": 40", "\"limit\": 15"), "`limit` = 15"),
            (&draw("").replace("\"limit\": 40", "\"limit\": -1"), "not understood"),
            (&draw("").replace("EYE", &EYE.replace("80", "4097")), "`width` = 4097"),
            (&draw("").replace("EYE", &EYE.replace("60", "1e3")), "not understood"),
            (&draw("").replace("EYE", &EYE.replace("1.5", "NaN")), "not understood"),
            (&draw("").replace("EYE", &EYE.replace("1.5", "-1.5")), "`fov` = -1.5"),
            (&draw("").replace("EYE", &EYE.replace("[1, 2", "[Infinity, 2")), "not understood"),
            (&draw("").replace("EYE", &EYE.replace("[1, 2", "[1e999, 2")), "not understood"),
            (&draw("").replace("EYE", &EYE.replace("[1, 2, 3]", "[1, 2]")), "not understood"),
            (&draw("").replace("EYE", &EYE.replace("[1, 0, 0, 0]", "[1, 0, 0, 0, 0]")), "not understood"),
            (&draw(r#", "time": -0.001"#), "`time` = -0.001"),
            (&draw(r#", "background": [0, 0, 1e39]"#), "`background` = inf"),
            (&draw(r#", "limit": 40"#), "duplicate field `limit`"),
            (&draw(r#", "path": "/etc/passwd""#), "unknown field `path`"),
            (&draw(r#", "at": [0, 0]"#), "unknown field `at`"),
            (&draw(r#", "appearance": {"file": 1}"#), "unknown field `file`"),
            (r#"{"type": "pick", "id": 1, EYE, "at": [0, 1], "layer": "colour"}"#, "unknown field `layer`"),
            (r#"{"type": "save", "crop": {}, "file": "../x"}"#, "unknown field `file`"),
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
    fn any_bytes_get_one_short_line() {
        let long = format!(r#"{{"type": "{}\n"}}"#, "y".repeat(10_000));
        let deep = format!("{}1{}", "[".repeat(8000), "]".repeat(8000));
        let line_break = br#"{"type": "a\nb\u0000c"}"#;
        let inputs: [&[u8]; 7] = [
            b"",
            b"\xff\xfe",
            b"{\"type\": \"\xff\"}",
            line_break,
            long.as_bytes(),
            deep.as_bytes(),
            &[b' '; LARGEST_MESSAGE + 1],
        ];
        for bytes in inputs {
            let error = Message::read(bytes).unwrap_err();
            assert!(!error.is_empty() && error.chars().count() <= LONGEST_SENTENCE, "{error}");
            assert!(!error.contains(char::is_control), "{error:?}");
        }
    }

    #[test]
    fn a_camera_sees_the_same_at_every_size() {
        let Ok(Message::Draw(draw)) = parse(r#"{"type": "draw", "id": 1, EYE, "layer": "colour", "limit": 80}"#) else {
            panic!("a good message")
        };
        let camera = draw.eye.camera(Size::new(80, 60));
        assert!((2.0 * (30.0 / camera.fy).atan() - 1.5).abs() < 1e-12 && (camera.fx - camera.fy).abs() < 1e-9);
        assert_eq!(camera.pose.c, DVec3::new(1.0, 2.0, 3.0));
        for size in [(40, 30), (13, 10), (1, 1)] {
            let other = draw.eye.camera(size.into());
            let corner = other.ray(DVec2::ZERO).unwrap();
            assert!((corner.d - camera.ray(DVec2::ZERO).unwrap().d).length() < 1e-12, "{size:?}");
        }
    }

    #[test]
    fn a_pick_looks_through_its_place_in_the_picture() {
        let Ok(Message::Pick(pick)) = parse(r#"{"type": "pick", "id": 1, EYE, "at": [0.25, 0.9]}"#) else {
            panic!("a good message")
        };
        let whole = pick.eye.camera(Size::new(80, 60)).ray(DVec2::new(20.0, 54.0)).unwrap();
        let one = pick.camera().ray(DVec2::splat(0.5)).unwrap();
        assert!((whole.d - one.d).length() < 1e-12 && whole.o == one.o);
    }
}
