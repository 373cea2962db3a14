//! Curves over logarithmic axes, as SVG.

use plotters::coord::Shift;
use plotters::prelude::*;

use super::plot::{COLOURS, Drawn, GREY, SIZE};

/// A plot.
pub(super) struct LogLog<'a> {
    /// What stands above it.
    pub caption: &'a str,
    /// What the horizontal axis shows.
    pub x: &'a str,
    /// What the vertical axis shows.
    pub y: &'a str,
    /// What is drawn.
    pub series: Vec<Series>,
}

/// Points that belong together; those that are not above zero are left out.
pub(super) struct Series {
    /// Its name in the legend; without one it is not in it.
    pub label: Option<String>,
    /// The points.
    pub points: Vec<(f64, f64)>,
    /// Number of its colour; grey without one.
    pub colour: Option<usize>,
    /// How it is drawn.
    pub style: Style,
}

/// How points are drawn.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Style {
    /// Points and a line through them.
    Line,
    /// Circles.
    Circles,
    /// A thin line that does not count for the axes.
    Guide,
}

impl Series {
    fn points(&self) -> impl Iterator<Item = (f64, f64)> + '_ {
        self.points.iter().copied().filter(|(x, y)| *x > 0.0 && *y > 0.0 && x.is_finite() && y.is_finite())
    }

    fn colour(&self) -> RGBColor {
        self.colour.map_or(GREY, |number| COLOURS[number % COLOURS.len()])
    }
}

impl LogLog<'_> {
    /// Draws it.
    pub fn svg(&self) -> Result<String, String> {
        let mut svg = String::new();
        let area = SVGBackend::with_string(&mut svg, SIZE).into_drawing_area();
        self.draw(&area).map_err(|problem| problem.to_string())?;
        drop(area);
        Ok(svg)
    }

    fn draw<'a>(&self, area: &DrawingArea<SVGBackend<'a>, Shift>) -> Drawn<'a> {
        area.fill(&WHITE)?;
        let points = || self.series.iter().filter(|s| s.style != Style::Guide).flat_map(Series::points);
        let (x, y) = (range(points().map(|(x, _)| x)), range(points().map(|(_, y)| y)));
        let mut chart = ChartBuilder::on(area)
            .caption(self.caption, ("sans-serif", 18))
            .margin(12)
            .x_label_area_size(40)
            .y_label_area_size(64)
            .build_cartesian_2d((x.0..x.1).log_scale(), (y.0..y.1).log_scale())?;
        chart
            .configure_mesh()
            .x_desc(self.x)
            .y_desc(self.y)
            .x_label_formatter(&|x| short(*x))
            .y_label_formatter(&|y| short(*y))
            .light_line_style(RGBColor(240, 240, 240))
            .draw()?;
        for series in &self.series {
            let colour = series.colour();
            let width = if series.style == Style::Guide { 1 } else { 2 };
            if series.style != Style::Circles {
                let line = LineSeries::new(series.points(), colour.stroke_width(width));
                let drawn = chart.draw_series(line)?;
                if let Some(label) = &series.label {
                    drawn.label(label).legend(move |(x, y)| {
                        PathElement::new([(x, y), (x + 18, y)], colour.stroke_width(width))
                    });
                }
            }
            match series.style {
                Style::Guide => {}
                Style::Line => {
                    chart.draw_series(series.points().map(|at| Circle::new(at, 3, colour.filled())))?;
                }
                Style::Circles => {
                    let drawn = chart.draw_series(series.points().map(|at| Circle::new(at, 5, colour)))?;
                    if let Some(label) = &series.label {
                        drawn.label(label).legend(move |(x, y)| Circle::new((x + 9, y), 5, colour));
                    }
                }
            }
        }
        chart
            .configure_series_labels()
            .position(SeriesLabelPosition::UpperRight)
            .background_style(WHITE.mix(0.8))
            .border_style(GREY)
            .draw()?;
        area.present()
    }
}

/// A range round all values.
fn range(values: impl Iterator<Item = f64>) -> (f64, f64) {
    let (least, most) = values.fold((f64::INFINITY, 0.0f64), |(least, most), v| (least.min(v), most.max(v)));
    if most > 0.0 { (least / 1.5, most * 1.5) } else { (0.1, 10.0) }
}

/// A number with no more digits than it needs.
fn short(value: f64) -> String {
    match value {
        v if v >= 1e6 => format!("{:.0} M", v / 1e6),
        v if v >= 1e3 => format!("{:.0} k", v / 1e3),
        v => format!("{}", (v * 1e6).round() / 1e6),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_what_has_a_logarithm_is_drawn() {
        let series =
            |points| Series { label: Some("m3".to_owned()), points, colour: Some(0), style: Style::Line };
        let plot =
            |points| LogLog { caption: "Time", x: "error", y: "s", series: vec![series(points)] }.svg();
        let svg = plot(vec![(0.1, 1.0), (0.0, 3.0), (0.01, f64::NAN), (0.001, 100.0)]).unwrap();
        assert!(svg.starts_with("<svg") && svg.contains("m3"));
        assert_eq!(svg.matches("<circle").count(), 2);
        assert!(plot(vec![]).is_ok());
    }

    #[test]
    fn numbers_are_short() {
        assert_eq!([0.001, 0.3, 20.0, 4000.0, 2e6].map(short), ["0.001", "0.3", "20", "4 k", "2 M"]);
    }
}
