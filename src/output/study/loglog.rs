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
    /// Thin lines `y = factor · x`, each with its factor.
    pub guides: &'a [f64],
}

/// Points that belong together; those that are not above zero are left out.
pub(super) struct Series {
    /// Its name in the legend; without one it is not in it.
    pub label: Option<String>,
    /// The points.
    pub points: Vec<(f64, f64)>,
    /// Number of its colour.
    pub colour: usize,
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
}

impl Series {
    fn points(&self) -> impl Iterator<Item = (f64, f64)> + '_ {
        self.points.iter().copied().filter(|(x, y)| *x > 0.0 && *y > 0.0 && x.is_finite() && y.is_finite())
    }

    fn colour(&self) -> RGBColor {
        COLOURS[self.colour % COLOURS.len()]
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
        let points = || self.series.iter().flat_map(Series::points);
        let (x, y) = (decades(points().map(|(x, _)| x)), decades(points().map(|(_, y)| y)));
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
        for factor in self.guides {
            // Within the plot: what is outside would be moved to its border.
            let ends = [x.0.max(y.0 / factor), x.1.min(y.1 / factor)];
            if ends[0] < ends[1] {
                chart.draw_series(LineSeries::new(ends.map(|x| (x, factor * x)), GREY))?;
            }
        }
        for series in &self.series {
            let (colour, line) = (series.colour(), series.style == Style::Line);
            let drawn = match line {
                true => chart.draw_series(LineSeries::new(series.points(), colour.stroke_width(2)))?,
                false => chart.draw_series(series.points().map(|at| Circle::new(at, 5, colour)))?,
            };
            if let Some(label) = &series.label {
                let radius = if line { 3 } else { 5 };
                drawn
                    .label(label)
                    .legend(move |(x, y)| Circle::new((x + 9, y), radius, colour.stroke_width(2)));
            }
            if line {
                chart.draw_series(series.points().map(|at| Circle::new(at, 3, colour.filled())))?;
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

/// Whole decades round all values.
fn decades(values: impl Iterator<Item = f64>) -> (f64, f64) {
    let (least, most) = values.fold((f64::INFINITY, 0.0f64), |(least, most), v| (least.min(v), most.max(v)));
    if most == 0.0 {
        return (0.1, 10.0);
    }
    let least = least.log10().floor();
    (10f64.powf(least), 10f64.powf(most.log10().ceil().max(least + 1.0)))
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
        let series = |points| Series { label: Some("m3".to_owned()), points, colour: 0, style: Style::Line };
        let plot = |points| {
            LogLog { caption: "Time", x: "error", y: "s", series: vec![series(points)], guides: &[1.0, 1e9] }
                .svg()
        };
        let svg = plot(vec![(0.1, 1.0), (0.0, 3.0), (0.01, f64::NAN), (0.001, 100.0)]).unwrap();
        assert!(svg.starts_with("<svg") && svg.contains("m3"));
        assert_eq!(svg.matches("<circle").count(), 2 + 1, "and one in the legend");
        assert!(plot(vec![]).is_ok());
    }

    #[test]
    fn axes_hold_whole_decades() {
        assert_eq!(decades([0.2, 30.0].into_iter()), (0.1, 100.0));
        assert_eq!(decades([10.0].into_iter()), (10.0, 100.0));
        assert_eq!(decades([].into_iter()), (0.1, 10.0));
    }

    #[test]
    fn numbers_are_short() {
        assert_eq!([0.001, 0.3, 20.0, 4000.0, 2e6].map(short), ["0.001", "0.3", "20", "4 k", "2 M"]);
    }
}
