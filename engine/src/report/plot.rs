//! Curves as inline SVG.

use plotters::coord::Shift;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

/// Width and height of a plot, in SVG units.
const SIZE: (u32, u32) = (560, 280);
const GREY: RGBColor = RGBColor(100, 116, 139);
/// Points beyond this are left out: nothing measured is, and an axis could not be divided.
const MOST: f64 = 1e15;
const FAINT: RGBColor = RGBColor(226, 232, 240);

/// A curve: points (x, y), ascending in x.
pub(super) struct Curve {
    pub(super) name: &'static str,
    pub(super) colour: RGBColor,
    pub(super) points: Vec<(f64, f64)>,
    pub(super) marks: Marks,
}

/// How the points of a curve are drawn.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Marks {
    /// A line alone.
    Line,
    /// A line with a dot at each point.
    Dots,
}

/// Scale of the y axis.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Scale {
    /// As it is.
    Linear,
    /// Logarithm to base 10; values `<= 0` are left out.
    Log,
}

/// A plot over training seconds; `None` when no curve has a point.
pub(super) fn plot(title: &str, unit: &str, scale: Scale, curves: &[Curve]) -> Option<String> {
    let transform = |y: f64| if scale == Scale::Log { y.log10() } else { y };
    let drawn = |(x, y): &(f64, f64)| (0.0..=MOST).contains(x) && y.abs() <= MOST;
    let curves: Vec<(&Curve, Vec<(f64, f64)>)> =
        curves.iter().map(|c| (c, c.points.iter().map(|&(x, y)| (x, transform(y))).filter(drawn).collect())).collect();
    let all = || curves.iter().flat_map(|(_, points)| points);
    let most = |f: fn(f64, f64) -> f64, of: fn(&(f64, f64)) -> f64| all().map(of).reduce(f);
    let (low, high) = (most(f64::min, |p| p.1)?, most(f64::max, |p| p.1)?);
    let end = most(f64::max, |p| p.0)?.max(1e-3);
    let margin = ((high - low) * 0.08).max(if scale == Scale::Log { 0.1 } else { high.abs() * 0.02 + 1e-9 });
    let (low, high) = (low - margin, high + margin);

    let mut svg = String::new();
    draw(&mut svg, title, unit, scale, &Range { end, low, high }, &curves)?;
    Some(svg)
}

/// What the axes hold: training seconds from 0 to `end`, values from `low` to `high`.
struct Range {
    end: f64,
    low: f64,
    high: f64,
}

fn draw(
    svg: &mut String,
    title: &str,
    unit: &str,
    scale: Scale,
    range: &Range,
    curves: &[(&Curve, Vec<(f64, f64)>)],
) -> Option<()> {
    let Range { end, low, high } = *range;
    let root: DrawingArea<SVGBackend<'_>, Shift> = SVGBackend::with_string(svg, SIZE).into_drawing_area();
    let font = |size: i32| ("sans-serif", size).into_font().color(&GREY);
    let mut chart = ChartBuilder::on(&root)
        .margin(8)
        .margin_top(30)
        .x_label_area_size(34)
        .y_label_area_size(56)
        .build_cartesian_2d(0.0..end * 1.01, low..high)
        .ok()?;
    chart
        .configure_mesh()
        .disable_x_mesh()
        .axis_style(FAINT)
        .bold_line_style(FAINT)
        .light_line_style(TRANSPARENT)
        .label_style(font(12))
        .x_labels(7)
        .y_labels(6)
        .x_label_formatter(&|x| short(*x))
        .y_label_formatter(&|y| if scale == Scale::Log { format!("{:.1e}", 10_f64.powf(*y)) } else { short(*y) })
        .x_desc("training seconds")
        .axis_desc_style(font(12))
        .draw()
        .ok()?;
    for (curve, points) in curves {
        chart.draw_series(LineSeries::new(points.iter().copied(), curve.colour.stroke_width(2))).ok()?;
        if curve.marks == Marks::Dots {
            chart.draw_series(points.iter().map(|&p| Circle::new(p, 4, curve.colour.filled()))).ok()?;
        }
    }
    let heading = ("sans-serif", 14).into_font().style(FontStyle::Bold).color(&RGBColor(30, 41, 59));
    root.draw(&Text::new(format!("{title}, {unit}"), (14, 6), heading)).ok()?;
    // The key, right-aligned in the title's line.
    let mut x = SIZE.0 as i32 - 14;
    for (curve, points) in curves.iter().rev().filter(|_| curves.len() > 1) {
        if points.is_empty() {
            continue;
        }
        let style = font(12).pos(Pos::new(HPos::Right, VPos::Top));
        root.draw(&Text::new(curve.name, (x, 8), style)).ok()?;
        // Letters of this size are about five units wide.
        x -= curve.name.len() as i32 * 5 + 12;
        root.draw(&Circle::new((x, 14), 4, curve.colour.filled())).ok()?;
        x -= 16;
    }
    root.present().ok()
}

/// A number for an axis: `12`, `1.5`, `20k`, `3.2M`, without zeros at its end.
fn short(x: f64) -> String {
    let (value, digits, unit) = match x.abs() {
        a if a >= 1e6 => (x / 1e6, 1, "M"),
        a if a >= 1e3 => (x / 1e3, 1, "k"),
        a if a >= 10.0 => (x, 1, ""),
        _ => (x, 2, ""),
    };
    let text = format!("{value:.digits$}");
    format!("{}{unit}", text.trim_end_matches('0').trim_end_matches('.'))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn curve(points: Vec<(f64, f64)>) -> Curve {
        Curve { name: "held out", colour: RGBColor(0, 0, 200), points, marks: Marks::Dots }
    }

    #[test]
    fn a_curve_becomes_svg_and_nothing_becomes_nothing() {
        let svg = plot("PSNR", "dB", Scale::Linear, &[curve(vec![(1.0, 20.0), (2.0, 25.0)])]).unwrap();
        assert!(svg.starts_with("<svg") && svg.trim_end().ends_with("</svg>"));
        assert_eq!(svg.matches("<circle").count(), 2);
        assert!(plot("PSNR", "dB", Scale::Linear, &[curve(Vec::new())]).is_none());
    }

    #[test]
    fn one_point_equal_values_and_values_without_a_logarithm_are_drawn() {
        assert!(plot("a", "b", Scale::Linear, &[curve(vec![(0.0, 0.0)])]).is_some());
        assert!(plot("a", "b", Scale::Linear, &[curve(vec![(1.0, 5.0), (2.0, 5.0)])]).is_some());
        let svg = plot("a", "b", Scale::Log, &[curve(vec![(1.0, 0.0), (2.0, 1e-3), (3.0, f64::NAN)])]).unwrap();
        assert_eq!(svg.matches("<circle").count(), 1);
        let far = vec![(f64::INFINITY, 1.0), (1.0, 1e308), (f64::NAN, 1.0), (-5.0, 1.0), (1e300, 1.0), (2.0, 3.0)];
        let svg = plot("a", "b", Scale::Linear, &[curve(far)]).unwrap();
        assert_eq!(svg.matches("<circle").count(), 1, "numbers that were never measured");
    }

    #[test]
    fn axis_numbers_are_short() {
        assert_eq!([0.0, 0.25, 12.0, 23_400.0, 3_200_000.0].map(short), ["0", "0.25", "12", "23.4k", "3.2M"]);
        assert_eq!([5.0, 1.5, 100.0, 2_000.0, -0.5].map(short), ["5", "1.5", "100", "2k", "-0.5"]);
    }
}
