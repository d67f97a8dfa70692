//! Trajectory → CSV.

use std::io::{self, Write};

use csv::Terminator;
use nalgebra::{Point2, Vector3};

use super::{COLUMNS, state_name};
use crate::vision::trajectory::{Sample, Trajectory};

/// Writes the header and one line per sample, in the trajectory's order, ended by `\n`.
///
/// Fails where `out` fails, and with `InvalidData` on a sample that no reader could use: a number that is not finite,
/// or a tool without a name in the trajectory.
pub fn write_csv(trajectory: &Trajectory, out: impl Write) -> io::Result<()> {
    let mut table = csv::WriterBuilder::new().terminator(Terminator::Any(b'\n')).from_writer(out);
    table.write_record(COLUMNS).map_err(into_io)?;
    for sample in &trajectory.samples {
        table.write_record(fields(trajectory, sample)?).map_err(into_io)?;
    }
    table.flush()
}

fn fields(trajectory: &Trajectory, sample: &Sample) -> io::Result<[String; COLUMNS.len()]> {
    let name = trajectory.tools.get(sample.tool).ok_or_else(|| unusable_value(sample, "tool"))?;
    let number = |column: &str, value: f64| {
        if value.is_finite() { Ok(value.to_string()) } else { Err(unusable_value(sample, column)) }
    };
    let maybe = |column: &str, value: Option<f64>| value.map_or(Ok(String::new()), |v| number(column, v));
    let [vx, vy, vz] = parts(sample.velocity_mm_s);
    let [ax, ay, az] = parts(sample.axis);
    let [xx, xy, xz, yy, yz, zz] = sample.covariance_mm2.map_or([None; 6], |of| of.upper().map(Some));
    let pixel = |pick: fn(&Point2<f64>) -> f64| sample.tip_px.as_ref().map(pick);
    Ok([
        sample.frame.to_string(),
        number("time_s", sample.time_s)?,
        name.clone(),
        number("x_mm", sample.tip_mm.x)?,
        number("y_mm", sample.tip_mm.y)?,
        number("z_mm", sample.tip_mm.z)?,
        maybe("vx_mm_s", vx)?,
        maybe("vy_mm_s", vy)?,
        maybe("vz_mm_s", vz)?,
        maybe("axis_x", ax)?,
        maybe("axis_y", ay)?,
        maybe("axis_z", az)?,
        maybe("tip_u_px", pixel(|p| p.x))?,
        maybe("tip_v_px", pixel(|p| p.y))?,
        maybe("sigma_xy_mm", sample.sigma_xy_mm())?,
        maybe("sigma_z_mm", sample.sigma_z_mm())?,
        state_name(sample.state).to_owned(),
        maybe("cov_xx_mm2", xx)?,
        maybe("cov_xy_mm2", xy)?,
        maybe("cov_xz_mm2", xz)?,
        maybe("cov_yy_mm2", yy)?,
        maybe("cov_yz_mm2", yz)?,
        maybe("cov_zz_mm2", zz)?,
    ])
}

fn parts(vector: Option<Vector3<f64>>) -> [Option<f64>; 3] {
    vector.map_or([None; 3], |v| [Some(v.x), Some(v.y), Some(v.z)])
}

fn unusable_value(sample: &Sample, column: &str) -> io::Error {
    let what = format!("frame {}, tool {}: `{column}` is not a usable value", sample.frame, sample.tool);
    io::Error::new(io::ErrorKind::InvalidData, what)
}

/// The stream's own error with its kind, if the CSV error has one.
fn into_io(error: csv::Error) -> io::Error {
    match error.into_kind() {
        csv::ErrorKind::Io(error) => error,
        other => io::Error::other(format!("{other:?}")),
    }
}
