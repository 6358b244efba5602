//! A chart of lines as SVG.

use plotters::coord::Shift;
use plotters::coord::ranged1d::{AsRangedCoord, ValueFormatter};
use plotters::element::DashedPathElement;
use plotters::prelude::*;

/// Why a plot could not be drawn.
#[derive(Debug, thiserror::Error)]
#[error("the plot \"{title}\" could not be drawn: {reason}")]
pub struct PlotFailed {
    title: String,
    reason: String,
}

/// What is drawn.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Chart {
    /// What stands above it.
    pub title: String,
    /// What stands below the horizontal axis, and which scale that has.
    pub x: (&'static str, Scale),
    /// What stands beside the vertical axis, which is linear and starts at 0.
    pub y: &'static str,
    /// What is in it.
    pub lines: Vec<Line>,
}

/// The scale of a horizontal axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Scale {
    /// Whole numbers.
    Counting,
    /// Positive numbers, decades equally wide.
    Logarithmic,
}

/// One line of a chart.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Line {
    /// Its name in the legend.
    pub name: String,
    /// Red, green and blue.
    pub color: [u8; 3],
    /// Whether it is dashed, or else solid.
    pub is_dashed: bool,
    /// What it connects.
    pub points: Vec<(f64, f64)>,
}

const WIDTH: u32 = 960;
const HEIGHT: u32 = 480;
/// The part of the width that the legend takes.
const LEGEND_WIDTH: u32 = 210;
const FONT: &str = "sans-serif";
const LINE_WIDTH: u32 = 2;
/// The lengths of a dash and of the gap after it: every dash costs bytes.
const DASH: u32 = 14;
const GAP: u32 = 8;
/// More points than this are no longer marked one by one.
const MAX_MARKED_POINTS: usize = 20;

type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;
type Drawn<'a> = Result<(), DrawingAreaErrorKind<<SVGBackend<'a> as DrawingBackend>::ErrorType>>;

/// Draws `chart`.
///
/// # Errors
///
/// [`PlotFailed`] if the library refuses it.
pub(super) fn svg(chart: &Chart) -> Result<String, PlotFailed> {
    let mut text = String::new();
    draw(chart, &mut text).map_err(|error| PlotFailed {
        title: chart.title.clone(),
        reason: error.to_string(),
    })?;
    Ok(compact(&text))
}

/// The library writes every dash as an element of its own, and says what goes without saying:
/// elements of one style become one path, and defaults are left out.
fn compact(text: &str) -> String {
    let mut short = String::with_capacity(text.len());
    let mut open: Option<&str> = None;
    for line in text.lines() {
        let polyline = line
            .strip_prefix("<polyline ")
            .and_then(|rest| rest.split_once("points=\""))
            .and_then(|(style, rest)| Some((style, rest.strip_suffix(" \"/>")?)));
        if open.is_some() && open != polyline.map(|(style, _)| style) {
            short.push_str("\"/>\n");
            open = None;
        }
        let Some((style, points)) = polyline else {
            short.push_str(line);
            short.push('\n');
            continue;
        };
        if open.is_none() {
            short.push_str(&format!("<path {style}d=\""));
            open = Some(style);
        }
        short.push('M');
        short.push_str(points);
    }
    for default in [
        " opacity=\"1\"",
        " stroke=\"none\"",
        " stroke-width=\"1\"",
        " fill=\"#000000\"",
        " font-family=\"sans-serif\"",
    ] {
        short = short.replace(default, "");
    }
    short.replacen("<svg ", "<svg font-family=\"sans-serif\" ", 1)
}

fn draw<'a>(chart: &Chart, text: &'a mut String) -> Drawn<'a> {
    let root = SVGBackend::with_string(text, (WIDTH, HEIGHT)).into_drawing_area();
    root.fill(&WHITE)?;
    let (left, right) = root.split_horizontally(WIDTH - LEGEND_WIDTH);
    let (low, high) = x_range(chart);
    match chart.x.1 {
        Scale::Counting => draw_axes_and_lines(chart, &left, low - 0.5..high + 0.5)?,
        Scale::Logarithmic => draw_axes_and_lines(chart, &left, (low..high).log_scale())?,
    }
    draw_legend(chart, &right)?;
    root.present()
}

fn draw_axes_and_lines<'a, X>(chart: &Chart, area: &Area<'a>, x_range: X) -> Drawn<'a>
where
    X: AsRangedCoord<Value = f64>,
    X::CoordDescType: ValueFormatter<f64>,
{
    let highest = points(chart).map(|(_, y)| y).fold(0.0, f64::max);
    let y_range = 0.0..if highest == 0.0 { 1.0 } else { 1.05 * highest };
    let mut axes = ChartBuilder::on(area)
        .caption(&chart.title, (FONT, 21))
        .margin(12)
        .x_label_area_size(52)
        .y_label_area_size(76)
        .build_cartesian_2d(x_range, y_range)?;
    let (x_label, scale) = chart.x;
    let (low, high) = self::x_range(chart);
    axes.configure_mesh()
        .x_desc(x_label)
        .y_desc(chart.y)
        .axis_desc_style((FONT, 18))
        .label_style((FONT, 16))
        .x_labels(match scale {
            // Ticks between whole numbers would have no meaning.
            Scale::Counting => ((high - low) as usize + 1).min(16),
            Scale::Logarithmic => 10,
        })
        .y_labels(8)
        .x_label_formatter(&|x| tick(*x, scale == Scale::Counting))
        .y_label_formatter(&|y| tick(*y, false))
        .light_line_style(TRANSPARENT)
        .draw()?;
    for line in &chart.lines {
        let style = style(line);
        if line.is_dashed {
            let points = line.points.iter().copied();
            axes.draw_series(DashedLineSeries::new(points, DASH, GAP, style))?;
        } else {
            axes.draw_series(LineSeries::new(line.points.iter().copied(), style))?;
        }
        if scale == Scale::Counting && line.points.len() <= MAX_MARKED_POINTS {
            let marks = line
                .points
                .iter()
                .map(|&point| Circle::new(point, 4, style.filled()));
            axes.draw_series(marks)?;
        }
    }
    Ok(())
}

/// Beside the chart, where no line can hide it.
fn draw_legend<'a>(chart: &Chart, area: &Area<'a>) -> Drawn<'a> {
    for (line, y) in chart.lines.iter().zip((60..).step_by(30)) {
        let sample = [(4, y), (40, y)];
        if line.is_dashed {
            let dashes = DashedPathElement::new(sample, DASH, GAP, style(line));
            area.draw(&dashes)?;
        } else {
            area.draw(&PathElement::new(sample, style(line)))?;
        }
        let name = Text::new(line.name.clone(), (50, y - 8), (FONT, 17));
        area.draw(&name)?;
    }
    Ok(())
}

fn style(line: &Line) -> ShapeStyle {
    let [red, green, blue] = line.color;
    RGBColor(red, green, blue).stroke_width(LINE_WIDTH)
}

fn points(chart: &Chart) -> impl Iterator<Item = (f64, f64)> {
    chart
        .lines
        .iter()
        .flat_map(|line| line.points.iter().copied())
}

/// From the first to the last x; some range if there are no points.
fn x_range(chart: &Chart) -> (f64, f64) {
    let (low, high) = points(chart).fold((f64::INFINITY, 0.0_f64), |(low, high), (x, _)| {
        (low.min(x), high.max(x))
    });
    if low <= high {
        (low, high)
    } else {
        (1.0, 10.0)
    }
}

/// A number without digits that say nothing; `is_whole` leaves out those between whole numbers.
fn tick(value: f64, is_whole: bool) -> String {
    if is_whole && value.fract() != 0.0 {
        return String::new();
    }
    let digits = format!("{value:.6}");
    digits
        .trim_end_matches('0')
        .trim_end_matches('.')
        .to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn chart(scale: Scale, points: &[(f64, f64)]) -> Chart {
        let line = |name: &str, is_dashed| Line {
            name: name.to_owned(),
            color: [1, 2, 3],
            is_dashed,
            points: points.to_vec(),
        };
        Chart {
            title: "one < two".to_owned(),
            x: ("across", scale),
            y: "up",
            lines: vec![line("first", false), line("second", true)],
        }
    }

    #[test]
    fn a_chart_has_its_title_its_axes_and_its_legend() {
        let text = svg(&chart(Scale::Counting, &[(1.0, 0.2), (2.0, 0.4)])).unwrap();
        for label in ["one &lt; two", "across", "up", "first", "second"] {
            assert!(text.contains(label), "{label} is missing:\n{text}");
        }
        assert!(text.starts_with("<svg") && text.trim_end().ends_with("</svg>"));
        assert_eq!(text.matches("<circle").count(), 4);
    }

    #[test]
    fn twice_as_much_is_twice_as_high() {
        let text = svg(&chart(
            Scale::Counting,
            &[(1.0, 0.2), (2.0, 0.4), (3.0, 0.0)],
        ))
        .unwrap();
        let heights: Vec<f64> = text
            .split("cy=\"")
            .skip(1)
            .map(|rest| rest.split('"').next().unwrap().parse().unwrap())
            .collect();
        let [low, high, zero] = heights[..3] else {
            panic!("three marks")
        };
        // Coordinates are whole pixels.
        assert!(
            ((zero - high) - 2.0 * (zero - low)).abs() <= 2.0,
            "{heights:?}"
        );
    }

    #[test]
    fn a_chart_of_nothing_one_point_or_zeros_is_still_a_chart() {
        for scale in [Scale::Counting, Scale::Logarithmic] {
            for points in [vec![], vec![(3.0, 0.5)], vec![(3.0, 0.0), (4.0, 0.0)]] {
                let text = svg(&chart(scale, &points)).unwrap();
                assert!(!text.contains("NaN"), "{points:?}");
            }
        }
    }

    #[test]
    fn the_dashes_of_a_line_are_one_path_and_lines_of_another_style_are_not() {
        let line = |color: &str, points: &str| {
            format!(
                "<polyline fill=\"none\" opacity=\"1\" stroke=\"{color}\" points=\"{points} \"/>\n"
            )
        };
        let text = line("#a", "1,2 3,4") + &line("#a", "5,6 7,8") + &line("#b", "0,0 1,1");
        assert_eq!(
            compact(&(text + "</svg>\n")),
            "<path fill=\"none\" stroke=\"#a\" d=\"M1,2 3,4M5,6 7,8\"/>\n\
             <path fill=\"none\" stroke=\"#b\" d=\"M0,0 1,1\"/>\n</svg>\n"
        );
    }

    #[test]
    fn ticks_have_no_digits_that_say_nothing() {
        assert_eq!(tick(0.05, false), "0.05");
        assert_eq!(tick(100.0, false), "100");
        assert_eq!(
            (tick(3.0, true), tick(3.5, true)),
            ("3".into(), String::new())
        );
    }
}
