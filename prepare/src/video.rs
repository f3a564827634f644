//! A video to frames: candidates by `ffmpeg`, the sharpest of each stretch of time kept.

use crate::error::PrepareError;
use crate::sharpness::{sharpest_of_windows, sharpness};
use crate::stage::fresh_folder;
use crate::tool::{Job, Log, Toolbox, install, run};
use crate::watch::{Event, Meter, Watch};
use rayon::prelude::*;
use scene_io::with_photo;
use serde_json::Value;
use std::ffi::OsString;
use std::path::{Path, PathBuf};

/// Candidates for each frame wanted: enough to pass over a shake.
const CANDIDATES: f64 = 4.0;
/// Candidates decoded before progress is told.
const CHUNK: usize = 16;

/// The two programs of ffmpeg.
#[derive(Clone, Debug)]
pub(crate) struct Ffmpeg {
    ffmpeg: PathBuf,
    ffprobe: PathBuf,
}

/// What a video's headers say.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct About {
    /// Frames per second as a fraction.
    pub(crate) rate: (u64, u64),
    /// Seconds.
    pub(crate) seconds: f64,
    /// Columns, rows; before rotation.
    pub(crate) size: (u64, u64),
}

impl About {
    fn frames(&self) -> f64 {
        self.seconds * self.rate.0 as f64 / self.rate.1 as f64
    }
}

/// What frames are taken, and where they go.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Wanted<'a> {
    /// How many.
    pub(crate) frames: usize,
    /// Their longest side, pixels; `None`: as in the video.
    pub(crate) longest: Option<u32>,
    /// What the video's headers say.
    pub(crate) about: About,
    /// Where they go; emptied first.
    pub(crate) folder: &'a Path,
    /// For candidates; emptied first, and gone afterwards.
    pub(crate) scratch: &'a Path,
}

impl Ffmpeg {
    /// # Errors
    /// [`PrepareError::Missing`].
    pub(crate) fn find(tools: &Toolbox) -> Result<Self, PrepareError> {
        match (tools.find("ffmpeg"), tools.find("ffprobe")) {
            (Some(ffmpeg), Some(ffprobe)) => Ok(Self { ffmpeg, ffprobe }),
            _ => Err(PrepareError::Missing {
                purpose: "taking frames out of a video",
                program: "ffmpeg (with ffprobe)",
                remedy: install(tools, "ffmpeg", "ffmpeg", "https://ffmpeg.org/download.html"),
            }),
        }
    }

    /// `5.1.9`, as the program says it.
    pub(crate) fn version(&self, tools: &Toolbox) -> String {
        let text = tools.ask(&self.ffmpeg, &["-version"]).unwrap_or_default();
        text.split_whitespace().nth(2).unwrap_or("of unknown version").to_string()
    }

    /// Asks `ffprobe` about a file.
    ///
    /// # Errors
    /// [`PrepareError::Input`] where it holds no video.
    pub(crate) fn about(&self, tools: &Toolbox, video: &Path) -> Result<About, PrepareError> {
        let mut words: Vec<OsString> =
            ["-v", "error", "-select_streams", "v:0", "-show_entries"].map(Into::into).into();
        words.push("stream=avg_frame_rate,r_frame_rate,duration,nb_frames,width,height:format=duration".into());
        words.extend(["-of", "json", "-i"].map(Into::into));
        words.push(file_word(video));
        let answer = tools.ask(&self.ffprobe, &words).unwrap_or_default();
        // What it complains of stands after the JSON.
        let json = answer.rfind('}').map_or("", |end| &answer[..=end]);
        parse_about(json).ok_or_else(|| {
            let said = answer.lines().map(str::trim).rfind(|l| !l.is_empty() && !l.starts_with(['{', '}', ']', '"']));
            let said = said.map(|l| format!(" (ffprobe: {l})")).unwrap_or_default();
            PrepareError::input(
                video,
                format!("holds no video that ffprobe can read{said}"),
                "give a video file, or a folder of photos",
            )
        })
    }

    /// Writes the wanted frames, or fewer, into a folder, named in the order of time. ffmpeg turns them upright. Returns their
    /// names.
    ///
    /// # Errors
    /// [`PrepareError`] where ffmpeg fails or a file cannot be written.
    pub(crate) fn frames(
        &self,
        tools: &Toolbox,
        video: &Path,
        wanted: &Wanted<'_>,
        log: &mut Log,
        watch: &mut dyn Watch,
    ) -> Result<Vec<String>, PrepareError> {
        let &Wanted { frames: wanted, longest, ref about, folder, scratch } = wanted;
        fresh_folder(scratch)?;
        let rate = candidate_rate(about, wanted);
        let expected = (about.seconds * rate.0 as f64 / rate.1 as f64).ceil().max(1.0) as usize;
        let mut filter = format!("fps={}/{}", rate.0, rate.1);
        if let Some(longest) = longest {
            // Both sides at most `longest`, the shape kept, never larger.
            filter.push_str(&format!(
                ",scale=w='min(iw,{longest})':h='min(ih,{longest})':force_original_aspect_ratio=decrease:flags=area"
            ));
        }
        let mut words: Vec<OsString> =
            ["-hide_banner", "-nostdin", "-y", "-v", "error", "-progress", "pipe:1", "-i"].map(Into::into).into();
        words.push(file_word(video));
        words.extend(["-map", "0:v:0", "-vf"].map(Into::into));
        words.extend([filter.into(), "-q:v".into(), "2".into(), scratch.join("%06d.jpg").into()]);
        let remedy = "play the video to see whether it is whole, or convert it to MP4";
        let job = Job { name: "ffmpeg", program: &self.ffmpeg, words, doing: "take frames out of the video", remedy };
        let mut meter = Meter::new("take frames", expected);
        run(tools, &job, log, watch, |line, watch| {
            if let Some(frame) = line.strip_prefix("frame=").and_then(|n| n.trim().parse().ok()) {
                meter.reach(frame, watch);
            }
        })?;
        let candidates = distinct(scratch)?;
        let marks = measure(&candidates, watch)?;
        let kept = sharpest_of_windows(&marks, wanted);
        fresh_folder(folder)?;
        let mut names = Vec::with_capacity(kept.len());
        for index in &kept {
            let Some(from) = candidates.get(*index) else { continue };
            let name = format!("{:05}.jpg", names.len() + 1);
            let to = folder.join(&name);
            std::fs::rename(from, &to).map_err(PrepareError::io(&to, "move a frame to"))?;
            names.push(name);
        }
        let found = candidates.len();
        watch.event(Event::Note(&format!("{} frames kept, the sharpest of {found} decoded", names.len())));
        crate::stage::remove_folder(scratch)?;
        Ok(names)
    }
}

/// Candidates per second: those of the video, or fewer.
fn candidate_rate(about: &About, wanted: usize) -> (u64, u64) {
    let wanted = wanted as f64 * CANDIDATES;
    if about.frames() <= wanted {
        return about.rate;
    }
    // In thousandths of a hertz; a video of weeks would round to none.
    (((wanted / about.seconds * 1000.0).round() as u64).max(1), 1000)
}

/// A file as ffmpeg's programs take it: a name like `concat:a` or `-y` is neither a protocol nor an option.
fn file_word(file: &Path) -> OsString {
    let mut word = OsString::from("file:");
    word.push(file);
    word
}

/// The candidates in the order of time, those left out that repeat the one before byte for byte: what `fps` fills gaps with.
fn distinct(folder: &Path) -> Result<Vec<PathBuf>, PrepareError> {
    let entries = std::fs::read_dir(folder).map_err(PrepareError::io(folder, "list the folder"))?;
    let mut files: Vec<PathBuf> = entries.filter_map(|e| e.ok().map(|e| e.path())).collect();
    files.sort();
    let mut before = Vec::new();
    let mut kept = Vec::with_capacity(files.len());
    for file in files {
        let bytes = std::fs::read(&file).map_err(PrepareError::io(&file, "read the frame"))?;
        if bytes != before {
            kept.push(file);
            before = bytes;
        }
    }
    Ok(kept)
}

/// Sharpness of each candidate; 0 for one that cannot be decoded.
fn measure(files: &[PathBuf], watch: &mut dyn Watch) -> Result<Vec<f64>, PrepareError> {
    let mut meter = Meter::new("measure sharpness", files.len());
    let mut marks = Vec::with_capacity(files.len());
    for chunk in files.chunks(CHUNK) {
        let some: Vec<f64> = chunk.par_iter().map(|f| with_photo(f, 2, |p| sharpness(&p)).unwrap_or(0.0)).collect();
        marks.extend(some);
        meter.reach(marks.len(), watch);
        if watch.stop_asked() {
            return Err(PrepareError::Stopped);
        }
    }
    Ok(marks)
}

fn parse_about(json: &str) -> Option<About> {
    let json: Value = serde_json::from_str(json).ok()?;
    let stream = json.get("streams")?.get(0)?;
    let text = |value: Option<&Value>| value.and_then(Value::as_str).map(str::to_string);
    let fraction = |key: &str| {
        let text = text(stream.get(key))?;
        let (a, b) = text.split_once('/')?;
        let (a, b) = (a.parse::<u64>().ok()?, b.parse::<u64>().ok()?);
        (a > 0 && b > 0 && a / b <= 1000).then_some((a, b))
    };
    let rate = fraction("avg_frame_rate").or_else(|| fraction("r_frame_rate"))?;
    let number = |value: Option<&Value>| text(value)?.parse::<f64>().ok().filter(|x| x.is_finite() && *x > 0.0);
    let from_frames = || number(stream.get("nb_frames")).map(|n| n * rate.1 as f64 / rate.0 as f64);
    let seconds = number(stream.get("duration"))
        .or_else(|| number(json.get("format").and_then(|f| f.get("duration"))))
        .or_else(from_frames)?;
    let side = |key: &str| stream.get(key).and_then(Value::as_u64).filter(|n| *n > 0);
    Some(About { rate, seconds, size: (side("width")?, side("height")?) })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn headers_of_videos_are_read() {
        let json = r#"{"programs": [], "streams": [{"width": 1920, "height": 1080, "r_frame_rate": "30/1",
            "avg_frame_rate": "30000/1001", "duration": "12.5", "nb_frames": "375"}], "format": {"duration": "12.6"}}"#;
        let about = parse_about(json).unwrap();
        assert_eq!(about, About { rate: (30_000, 1001), seconds: 12.5, size: (1920, 1080) });
        // Matroska says the length once, for the file.
        let mkv = r#"{"streams": [{"width": 4, "height": 3, "r_frame_rate": "25/1", "avg_frame_rate": "0/0"}],
            "format": {"duration": "2.0"}}"#;
        assert_eq!(parse_about(mkv).unwrap().rate, (25, 1));
        for broken in ["", "{}", r#"{"streams": []}"#, r#"{"streams": [{"width": 3}]}"#] {
            assert_eq!(parse_about(broken), None, "{broken}");
        }
    }

    #[test]
    fn short_videos_give_all_frames_and_long_ones_some_for_each() {
        let about = |seconds| About { rate: (30, 1), seconds, size: (4, 3) };
        assert_eq!(candidate_rate(&about(10.0), 100), (30, 1));
        // 400 candidates in 60 s.
        assert_eq!(candidate_rate(&about(60.0), 100), (6667, 1000));
        assert_eq!(candidate_rate(&about(1e9), 2), (1, 1000));
    }

    /// A video of 48 frames at 12 a second, every fourth of them sharp.
    #[test]
    fn a_video_gives_its_sharpest_frames() {
        use crate::watch::Silent;
        use image::{DynamicImage, GrayImage, Luma};
        let tools = Toolbox::from_env();
        let Ok(ffmpeg) = Ffmpeg::find(&tools) else {
            eprintln!("SKIPPED: a_video_gives_its_sharpest_frames: there is no ffmpeg");
            return;
        };
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        for i in 0..48_u32 {
            let checks =
                GrayImage::from_fn(96, 64, |x, y| Luma([if ((x + i) / 6 + y / 6) % 2 == 0 { 30 } else { 220 }]));
            let picture = DynamicImage::from(checks);
            let picture = if i % 4 == 2 { picture } else { picture.blur(3.0) };
            picture.to_rgb8().save(at(&format!("{i:03}.png"))).unwrap();
        }
        let video = at("walk.mkv");
        let pattern = at("%03d.png");
        let words = ["-v", "error", "-framerate", "12", "-i", pattern.to_str().unwrap(), "-c:v", "ffv1"];
        let words: Vec<&str> = words.into_iter().chain([video.to_str().unwrap()]).collect();
        assert_eq!(tools.ask(&ffmpeg.ffmpeg, &words).as_deref(), Some(""));
        let about = ffmpeg.about(&tools, &video).unwrap();
        assert_eq!((about.rate, about.size), ((12, 1), (96, 64)));
        let mut log = Log::open(&at("log")).unwrap();
        let (frames, scratch) = (at("images"), at("scratch"));
        let wanted = Wanted { frames: 12, longest: Some(48), about, folder: &frames, scratch: &scratch };
        let names = ffmpeg.frames(&tools, &video, &wanted, &mut log, &mut Silent).unwrap();
        assert_eq!(names.len(), 12);
        let pictures: Vec<_> = names.iter().map(|n| scene_io::decode_photo(&frames.join(n)).unwrap()).collect();
        assert!(pictures.iter().all(|p| (p.width(), p.height()) == (48, 32)));
        let blurred = sharpness(&image::open(at("000.png")).unwrap().thumbnail(48, 32));
        for (name, picture) in names.iter().zip(&pictures) {
            assert!(sharpness(picture) > 2.0 * blurred, "{name}: {} against {blurred}", sharpness(picture));
        }
        assert!(!scratch.exists());
        let error = ffmpeg.about(&tools, &at("000.txt")).unwrap_err().to_string();
        assert!(error.contains("000.txt") && error.contains("holds no video"), "{error}");
    }
}
