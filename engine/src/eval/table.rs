//! Scores as files and tables.

use super::protocol::Protocol;
use super::score::{Evaluation, Measured};

impl Evaluation {
    /// `eval.json`.
    #[expect(clippy::missing_panics_doc, reason = "plain structs always serialise")]
    pub fn json(&self) -> String {
        let mut text = serde_json::to_string_pretty(self).expect("a plain struct serialises");
        text.push('\n');
        text
    }

    /// `eval.csv`: a row a view; empty where not measured.
    pub fn csv(&self) -> String {
        let mut out = String::from("name,psnr,ssim,ms_ssim,lpips,flip,render_seconds\n");
        for v in &self.views {
            let name = match v.name.contains([',', '"', '\n']) {
                true => format!("\"{}\"", v.name.replace('"', "\"\"")),
                false => v.name.clone(),
            };
            let show = |x: Option<f64>| x.map_or_else(String::new, |x| format!("{x:.6}"));
            let scores = [v.psnr, v.ssim, v.ms_ssim, v.lpips, v.flip].map(show).join(",");
            out += &format!("{name},{scores},{:.4}\n", v.render_seconds);
        }
        out
    }

    /// How much stands before the cameras, with the worst view; `None` where that is not measured.
    #[must_use]
    pub fn fog_line(&self) -> Option<String> {
        let mean = self.fog?;
        let worst = self.views.iter().filter_map(|v| Some((v.fog?, &v.name))).max_by(|a, b| a.0.total_cmp(&b.0))?;
        let (most, name) = (100.0 * worst.0, worst.1);
        Some(format!("fog before the cameras: {:.1} % (most {most:.1} %, {name})", 100.0 * mean))
    }

    /// The same as a table for a terminal, means last.
    pub fn table(&self) -> String {
        let widest = self.views.iter().map(|v| v.name.chars().count()).max().unwrap_or(0).clamp(4, 48);
        let row = |name: &str, scores: [Option<f64>; 4]| {
            let cell = |x: Option<f64>, digits: usize| x.map_or_else(|| "n/a".into(), |x| format!("{x:.digits$}"));
            let [psnr, ssim, ms_ssim, lpips] = scores;
            format!(
                "{name:widest$}  {:>8}  {:>7}  {:>7}  {:>7}\n",
                cell(psnr, 3),
                cell(ssim, 4),
                cell(ms_ssim, 4),
                cell(lpips, 4)
            )
        };
        let mut out =
            format!("{:widest$}  {:>8}  {:>7}  {:>7}  {:>7}\n", "view", "PSNR dB", "SSIM", "MS-SSIM", "LPIPS");
        for v in &self.views {
            let name: String = match v.name.chars().count() {
                n if n > widest => std::iter::once('…').chain(v.name.chars().skip(n - widest + 1)).collect(),
                _ => v.name.clone(),
            };
            out += &row(&name, [v.psnr, v.ssim, v.ms_ssim, v.lpips]);
        }
        out += &row("mean", [self.psnr, self.ssim, self.ms_ssim, self.lpips]);
        if self.left > 0 {
            let done = self.views.len();
            out += &format!("stopped after {done} of {} views: the mean is over these alone\n", done + self.left);
        }
        if self.split == Measured::Validation {
            out += "measured: validation views\n";
        }
        if let Some(db) = self.psnr_object {
            out += &format!("inside the masks of the object: {db:.3} dB\n");
        }
        if let Some(line) = self.fog_line() {
            out += &format!("{line}\n");
        }
        for line in self.motion.words() {
            out += &format!("{line}\n");
        }
        if self.protocol != Protocol::default() {
            out += &format!("protocol: {}\n", self.protocol);
        }
        if let Some(skips) = &self.skips {
            out += &format!("\n{}", skips.table());
        }
        out
    }
}
