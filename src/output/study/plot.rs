//! Plots of studies, as SVG.

use plotters::coord::Shift;
use plotters::prelude::*;

use crate::study::Speedup;

/// Width and height in pixels.
pub(super) const SIZE: (u32, u32) = (720, 560);

/// Colours that people who do not tell red from green tell apart (Okabe and Ito 2008).
pub(super) const COLOURS: [RGBColor; 7] = [
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(230, 159, 0),
    RGBColor(86, 180, 233),
    RGBColor(0, 0, 0),
];

/// What only guides the eye.
pub(super) const GREY: RGBColor = RGBColor(150, 150, 150);

/// Speed-up over workers on one machine: lines for what is predicted, circles for what was measured here, and the ideal.
pub(super) fn speedup(study: &Speedup, machine: &str) -> Result<String, String> {
    let mut svg = String::new();
    let area = SVGBackend::with_string(&mut svg, SIZE).into_drawing_area();
    draw(study, machine, &area).map_err(|problem| problem.to_string())?;
    drop(area);
    Ok(svg)
}

/// What drawing says.
pub(super) type Drawn<'a> = Result<(), DrawingAreaErrorKind<<SVGBackend<'a> as DrawingBackend>::ErrorType>>;

fn draw<'a>(study: &Speedup, machine: &str, area: &DrawingArea<SVGBackend<'a>, Shift>) -> Drawn<'a> {
    area.fill(&WHITE)?;
    let predicted = || study.predicted.iter().filter(|predicted| predicted.machine == machine);
    let most = predicted().map(|p| p.workers).chain(study.measured.iter().map(|m| m.threads)).max();
    let most = most.unwrap_or(1) as f64;
    let mut chart = ChartBuilder::on(area)
        .caption(format!("Speed-up on {machine}"), ("sans-serif", 18))
        .margin(12)
        .x_label_area_size(40)
        .y_label_area_size(44)
        .build_cartesian_2d(0.0..most, 0.0..most)?;
    chart.configure_mesh().x_desc("workers").y_desc("speed-up").light_line_style(TRANSPARENT).draw()?;
    chart
        .draw_series(LineSeries::new([(0.0, 0.0), (most, most)], GREY))?
        .label("ideal")
        .legend(move |(x, y)| PathElement::new([(x, y), (x + 18, y)], GREY));
    let mut schedules: Vec<&str> = Vec::new();
    let names = predicted().map(|p| &p.schedule).chain(study.measured.iter().map(|m| &m.schedule));
    for name in names {
        if !schedules.contains(&name.as_str()) {
            schedules.push(name);
        }
    }
    for (number, schedule) in schedules.into_iter().enumerate() {
        let colour = COLOURS[number % COLOURS.len()];
        let line = predicted().filter(|p| p.schedule == schedule).map(|p| (p.workers as f64, p.speed_up));
        chart
            .draw_series(LineSeries::new(line, colour.stroke_width(2)))?
            .label(schedule)
            .legend(move |(x, y)| PathElement::new([(x, y), (x + 18, y)], colour.stroke_width(2)));
        let measured = study.measured.iter().filter(|m| m.schedule == schedule);
        let circle = |m: &crate::study::speedup::Measured| {
            Circle::new((m.threads as f64, m.speed_up), 4, colour.filled())
        };
        chart.draw_series(measured.map(circle))?;
    }
    chart
        .configure_series_labels()
        .position(SeriesLabelPosition::UpperLeft)
        .background_style(WHITE.mix(0.8))
        .border_style(GREY)
        .draw()?;
    area.present()
}
