//! Curves as SVG, with logarithmic axes where asked.

use crate::error::BenchError;
use plotters::coord::Shift;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

/// Width and height, SVG units.
const SIZE: (i32, i32) = (760, 420);
/// Edges of the frame: left, top, right, bottom. The key stands on the right.
const FRAME: [i32; 4] = [72, 40, 540, 366];
const TEXT: RGBColor = RGBColor(51, 65, 85);
const FAINT: RGBColor = RGBColor(226, 232, 240);
const AXIS: RGBColor = RGBColor(148, 163, 184);
/// Told apart by most eyes, also on paper (Okabe and Ito).
const COLOURS: [RGBColor; 8] = [
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(230, 159, 0),
    RGBColor(86, 180, 233),
    RGBColor(0, 0, 0),
    RGBColor(128, 100, 60),
];

/// How an axis is divided.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Scale {
    Linear,
    /// Logarithmic; what is not positive is left out.
    Log,
}

/// An axis.
#[derive(Clone, Debug)]
pub(crate) struct Axis {
    pub(crate) label: &'static str,
    pub(crate) scale: Scale,
}

/// How a series is drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Style {
    /// Dots joined by a line.
    Line,
    /// Crosses: figures that were not measured in this run.
    Cross,
    /// A dashed line: a bound or a ceiling.
    Dashed,
}

/// Points with a name.
#[derive(Clone, Debug)]
pub(crate) struct Series {
    pub(crate) name: String,
    pub(crate) style: Style,
    pub(crate) points: Vec<(f64, f64)>,
}

impl Series {
    /// Dots joined by a line.
    pub(crate) fn line(name: impl Into<String>, points: Vec<(f64, f64)>) -> Self {
        Self { name: name.into(), style: Style::Line, points }
    }
}

/// A drawing.
#[derive(Clone, Debug)]
pub(crate) struct Plot {
    /// Stem of the SVG file.
    pub(crate) name: &'static str,
    pub(crate) title: String,
    pub(crate) x: Axis,
    pub(crate) y: Axis,
    pub(crate) series: Vec<Series>,
}

/// One axis ready to draw: values to positions.
struct Ruler {
    scale: Scale,
    low: f64,
    high: f64,
    /// Positions of `low` and `high`, SVG units.
    from: i32,
    to: i32,
}

impl Ruler {
    fn new(axis: &Axis, values: impl Iterator<Item = f64>, from: i32, to: i32) -> Option<Self> {
        let scale = axis.scale;
        let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
        for v in values.filter_map(|v| inner(scale, v)) {
            low = low.min(v);
            high = high.max(v);
        }
        if low > high {
            return None;
        }
        let least = if scale == Scale::Log { 0.3 } else { high.abs().max(low.abs()).max(1e-12) * 0.05 };
        let margin = ((high - low) * 0.06).max(if high - low < least { least / 2.0 } else { 0.0 });
        Some(Self { scale, low: low - margin, high: high + margin, from, to })
    }

    fn at(&self, value: f64) -> Option<i32> {
        let share = (inner(self.scale, value)? - self.low) / (self.high - self.low);
        Some(self.from + (share * f64::from(self.to - self.from)).round() as i32)
    }

    /// Values that get a line and a label.
    fn ticks(&self) -> Vec<f64> {
        let span = self.high - self.low;
        match self.scale {
            Scale::Linear => {
                let raw = span / 6.0;
                let power = 10_f64.powf(raw.log10().floor());
                let step = [1.0, 2.0, 5.0, 10.0].map(|m| m * power).into_iter().find(|&s| s >= raw).unwrap_or(raw);
                let first = (self.low / step).ceil() as i64;
                (first..).map(|i| i as f64 * step).take_while(|&v| v <= self.high).collect()
            }
            Scale::Log => {
                let marks: &[f64] = if span < 2.5 { &[1.0, 2.0, 5.0] } else { &[1.0] };
                let every = (span / 8.0).ceil().max(1.0) as i32;
                let (first, last) = (self.low.floor() as i32, self.high.ceil() as i32);
                (first..=last)
                    .filter(|e| e.rem_euclid(every) == 0)
                    .flat_map(|e| marks.iter().map(move |m| m * 10_f64.powi(e)))
                    .filter(|v| (self.low..=self.high).contains(&v.log10()))
                    .collect()
            }
        }
    }

    fn label(&self, value: f64) -> String {
        let power = value.abs().log10();
        if value != 0.0 && !(-2.01..4.99).contains(&power) {
            let (mantissa, exponent) = (value / 10_f64.powf(power.floor()), power.floor());
            return format!("{}e{exponent}", (mantissa * 10.0).round() / 10.0);
        }
        format!("{}", (value * 1e6).round() / 1e6)
    }
}

/// The value on an even scale, where it has one.
fn inner(scale: Scale, value: f64) -> Option<f64> {
    let value = match scale {
        Scale::Linear => value,
        Scale::Log if value > 0.0 => value.log10(),
        Scale::Log => return None,
    };
    value.is_finite().then_some(value)
}

impl Plot {
    /// The drawing as SVG; `None` without a point to draw.
    pub(crate) fn svg(&self) -> Result<Option<String>, BenchError> {
        let all = || self.series.iter().flat_map(|s| &s.points);
        // Only points that have a place on both axes count for either.
        let shown = |p: &&(f64, f64)| inner(self.x.scale, p.0).is_some() && inner(self.y.scale, p.1).is_some();
        let x = Ruler::new(&self.x, all().filter(shown).map(|p| p.0), FRAME[0], FRAME[2]);
        let y = Ruler::new(&self.y, all().filter(shown).map(|p| p.1), FRAME[3], FRAME[1]);
        let (Some(x), Some(y)) = (x, y) else { return Ok(None) };
        let mut svg = String::new();
        {
            let size = (SIZE.0 as u32, SIZE.1 as u32);
            let root = SVGBackend::with_string(&mut svg, size).into_drawing_area();
            self.draw(&root, &x, &y).map_err(|e| BenchError::Plot(self.name.into(), e.to_string()))?;
        }
        Ok(Some(svg))
    }

    fn draw<'a>(
        &self,
        root: &DrawingArea<SVGBackend<'a>, Shift>,
        x: &Ruler,
        y: &Ruler,
    ) -> Result<(), DrawingAreaErrorKind<<SVGBackend<'a> as DrawingBackend>::ErrorType>> {
        root.fill(&WHITE)?;
        let font = |size: i32, h: HPos, v: VPos| ("sans-serif", size).into_font().color(&TEXT).pos(Pos::new(h, v));
        let [left, top, right, bottom] = FRAME;
        for value in x.ticks() {
            let Some(at) = x.at(value) else { continue };
            root.draw(&PathElement::new(vec![(at, top), (at, bottom)], FAINT))?;
            root.draw(&Text::new(x.label(value), (at, bottom + 6), font(12, HPos::Center, VPos::Top)))?;
        }
        for value in y.ticks() {
            let Some(at) = y.at(value) else { continue };
            root.draw(&PathElement::new(vec![(left, at), (right, at)], FAINT))?;
            root.draw(&Text::new(y.label(value), (left - 7, at), font(12, HPos::Right, VPos::Center)))?;
        }
        root.draw(&Rectangle::new([(left, top), (right, bottom)], AXIS))?;
        root.draw(&Text::new(self.x.label, ((left + right) / 2, SIZE.1 - 12), font(13, HPos::Center, VPos::Bottom)))?;
        let turned = ("sans-serif", 13).into_font().transform(FontTransform::Rotate270).color(&TEXT);
        let turned = turned.pos(Pos::new(HPos::Center, VPos::Top));
        root.draw(&Text::new(self.y.label, (10, (top + bottom) / 2), turned))?;
        let heading = ("sans-serif", 15).into_font().style(FontStyle::Bold).color(&TEXT);
        root.draw(&Text::new(self.title.clone(), (left, 12), heading))?;

        let mut key = top + 6;
        for (i, series) in self.series.iter().enumerate() {
            let colour = COLOURS[i % COLOURS.len()];
            let points: Vec<(i32, i32)> = series.points.iter().filter_map(|p| Some((x.at(p.0)?, y.at(p.1)?))).collect();
            if points.is_empty() {
                continue;
            }
            mark(root, series.style, colour, &points)?;
            // The key: a sample of the line and the name, broken where it is long.
            mark(root, series.style, colour, &[(right + 14, key + 6), (right + 34, key + 6)])?;
            for part in broken(&series.name, 26) {
                root.draw(&Text::new(part, (right + 42, key), font(12, HPos::Left, VPos::Top)))?;
                key += 15;
            }
            key += 5;
        }
        root.present()
    }
}

/// A series of points in SVG units.
fn mark<'a>(
    root: &DrawingArea<SVGBackend<'a>, Shift>,
    style: Style,
    colour: RGBColor,
    points: &[(i32, i32)],
) -> Result<(), DrawingAreaErrorKind<<SVGBackend<'a> as DrawingBackend>::ErrorType>> {
    match style {
        Style::Line => {
            root.draw(&PathElement::new(points.to_vec(), colour.stroke_width(2)))?;
            points.iter().try_for_each(|&p| root.draw(&Circle::new(p, 3, colour.filled())))
        }
        Style::Cross => points.iter().try_for_each(|&p| root.draw(&Cross::new(p, 5, colour.stroke_width(2)))),
        Style::Dashed => points.windows(2).try_for_each(|pair| {
            let ((x0, y0), (x1, y1)) = (pair[0], pair[1]);
            let length = f64::from((x1 - x0).pow(2) + (y1 - y0).pow(2)).sqrt();
            let dashes = (length / 8.0).ceil().max(1.0) as i32;
            let at = |share: f64| {
                (x0 + (share * f64::from(x1 - x0)).round() as i32, y0 + (share * f64::from(y1 - y0)).round() as i32)
            };
            (0..dashes).try_for_each(|d| {
                let (a, b) = (f64::from(d) / f64::from(dashes), (f64::from(d) + 0.6) / f64::from(dashes));
                root.draw(&PathElement::new(vec![at(a), at(b)], colour.stroke_width(1)))
            })
        }),
    }
}

/// Words in lines of at most so many letters.
fn broken(text: &str, most: usize) -> Vec<String> {
    let mut lines: Vec<String> = Vec::new();
    for word in text.split_whitespace() {
        match lines.last_mut() {
            Some(line) if line.len() + 1 + word.len() <= most => {
                line.push(' ');
                line.push_str(word);
            }
            _ => lines.push(word.into()),
        }
    }
    lines
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plot(scale: Scale, points: Vec<(f64, f64)>) -> Plot {
        Plot {
            name: "p",
            title: "A title".into(),
            x: Axis { label: "x", scale },
            y: Axis { label: "y", scale },
            series: vec![Series::line("a < b", points)],
        }
    }

    #[test]
    fn points_are_drawn_and_nothing_is_not() {
        let svg = plot(Scale::Log, vec![(1.0, 1e-8), (100.0, 1e-2), (5.0, 0.0)]).svg().unwrap().unwrap();
        assert!(svg.starts_with("<svg") && svg.trim_end().ends_with("</svg>") && !svg.contains("NaN"));
        // Two points and the two of the key; the one without a logarithm is left out.
        assert_eq!(svg.matches("<circle").count(), 4);
        assert!(plot(Scale::Log, vec![(0.0, 1.0)]).svg().unwrap().is_none());
        assert!(plot(Scale::Linear, vec![(3.0, 3.0)]).svg().unwrap().is_some(), "one point alone");
        assert!(plot(Scale::Linear, vec![(0.0, 0.0)]).svg().unwrap().is_some(), "no extent at zero");
    }

    #[test]
    fn ticks_are_round_and_few() {
        let axis = |scale| Axis { label: "", scale };
        let of = |scale, low, high| {
            Ruler::new(&axis(scale), [low, high].into_iter(), 0, 100).map(|r| r.ticks()).unwrap_or_default()
        };
        assert_eq!(of(Scale::Log, 1.0, 1000.0), [1.0, 10.0, 100.0, 1000.0]);
        assert_eq!(of(Scale::Log, 1.1, 12.0), [1.0, 2.0, 5.0, 10.0]);
        assert!((3..9).contains(&of(Scale::Log, 1e-30, 1e2).len()));
        assert_eq!(of(Scale::Linear, 0.0, 10.0), [0.0, 2.0, 4.0, 6.0, 8.0, 10.0]);
        assert_eq!(broken("one two three", 8), ["one two", "three"]);
    }
}
