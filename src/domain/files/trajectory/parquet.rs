//! Trajectory → Parquet: the same table for column-based programs (pandas, DuckDB, Arrow).
//!
//! Uses the low-level writer: flat columns need no Arrow. Names are UTF-8 strings, absent numbers
//! are nulls, pages are compressed with Snappy.

use std::io::Write;
use std::sync::Arc;

use parquet::basic::Compression;
use parquet::data_type::{ByteArray, ByteArrayType, DataType, DoubleType, Int64Type};
use parquet::errors::ParquetError;
use parquet::file::properties::WriterProperties;
use parquet::file::writer::{SerializedFileWriter, SerializedRowGroupWriter};
use parquet::schema::parser::parse_message_type;

use super::columns::{SampleColumns, TrajectoryColumns};
use crate::vision::trajectory::Trajectory;

const SCHEMA: &str = "message trajectory {
    REQUIRED INT64 frame;
    REQUIRED DOUBLE time_s;
    REQUIRED BYTE_ARRAY tool (STRING);
    REQUIRED DOUBLE x_mm;
    REQUIRED DOUBLE y_mm;
    REQUIRED DOUBLE z_mm;
    OPTIONAL DOUBLE vx_mm_s;
    OPTIONAL DOUBLE vy_mm_s;
    OPTIONAL DOUBLE vz_mm_s;
    OPTIONAL DOUBLE axis_x;
    OPTIONAL DOUBLE axis_y;
    OPTIONAL DOUBLE axis_z;
    OPTIONAL DOUBLE tip_u_px;
    OPTIONAL DOUBLE tip_v_px;
    OPTIONAL DOUBLE sigma_xy_mm;
    OPTIONAL DOUBLE sigma_z_mm;
    REQUIRED BYTE_ARRAY state (STRING);
    OPTIONAL DOUBLE cov_xx_mm2;
    OPTIONAL DOUBLE cov_xy_mm2;
    OPTIONAL DOUBLE cov_xz_mm2;
    OPTIONAL DOUBLE cov_yy_mm2;
    OPTIONAL DOUBLE cov_yz_mm2;
    OPTIONAL DOUBLE cov_zz_mm2;
}";

/// Why a Parquet file could not be written.
#[derive(Debug, thiserror::Error)]
pub enum ParquetProblem {
    /// A row whose tool number has no name in the trajectory.
    #[error("a row names tool {0}, but the trajectory does not know it")]
    UnknownTool(usize),
    /// A frame number beyond the format's signed 64 bits.
    #[error("frame {0} is too large for Parquet")]
    FrameTooLarge(u64),
    /// The Parquet writer or the underlying stream failed.
    #[error("write Parquet")]
    Write(#[from] ParquetError),
}

/// Writes the trajectory's table as one Parquet row group.
pub fn write_parquet(trajectory: &Trajectory, out: impl Write + Send) -> Result<(), ParquetProblem> {
    let TrajectoryColumns { tools, columns } = TrajectoryColumns::from(trajectory);
    let frames = columns.frame.iter().map(|&f| i64::try_from(f).map_err(|_| ParquetProblem::FrameTooLarge(f)));
    let frames = frames.collect::<Result<Vec<_>, _>>()?;
    let names = columns.tool.iter().map(|&t| tools.get(t).ok_or(ParquetProblem::UnknownTool(t)));
    let names = names.map(|name| name.map(|n| ByteArray::from(n.as_str()))).collect::<Result<Vec<_>, _>>()?;

    let properties = WriterProperties::builder().set_compression(Compression::SNAPPY).build();
    let mut file = SerializedFileWriter::new(out, Arc::new(parse_message_type(SCHEMA)?), Arc::new(properties))?;
    let mut rows = file.next_row_group()?;
    write_columns(&mut rows, &frames, &names, &columns)?;
    rows.close()?;
    file.close()?;
    Ok(())
}

/// Writes the columns in the schema's order: the format identifies columns by position.
fn write_columns<W: Write + Send>(
    rows: &mut SerializedRowGroupWriter<'_, W>,
    frames: &[i64],
    names: &[ByteArray],
    columns: &SampleColumns,
) -> Result<(), ParquetError> {
    write::<Int64Type, _>(rows, frames, None)?;
    write::<DoubleType, _>(rows, &columns.time_s, None)?;
    write::<ByteArrayType, _>(rows, names, None)?;
    for column in [&columns.x_mm, &columns.y_mm, &columns.z_mm] {
        write::<DoubleType, _>(rows, column, None)?;
    }
    let optional = [
        &columns.vx_mm_s,
        &columns.vy_mm_s,
        &columns.vz_mm_s,
        &columns.axis_x,
        &columns.axis_y,
        &columns.axis_z,
        &columns.tip_u_px,
        &columns.tip_v_px,
        &columns.sigma_xy_mm,
        &columns.sigma_z_mm,
    ];
    optional.into_iter().try_for_each(|column| write_optional(rows, column))?;
    let states: Vec<ByteArray> = columns.state.iter().map(|&s| ByteArray::from(s)).collect();
    write::<ByteArrayType, _>(rows, &states, None)?;
    let covariances = [
        &columns.cov_xx_mm2,
        &columns.cov_xy_mm2,
        &columns.cov_xz_mm2,
        &columns.cov_yy_mm2,
        &columns.cov_yz_mm2,
        &columns.cov_zz_mm2,
    ];
    covariances.into_iter().try_for_each(|column| write_optional(rows, column))
}

fn write_optional<W: Write + Send>(
    rows: &mut SerializedRowGroupWriter<'_, W>,
    column: &[Option<f64>],
) -> Result<(), ParquetError> {
    let present: Vec<i16> = column.iter().map(|value| i16::from(value.is_some())).collect();
    let values: Vec<f64> = column.iter().copied().flatten().collect();
    write::<DoubleType, _>(rows, &values, Some(&present))
}

fn write<T: DataType, W: Write + Send>(
    rows: &mut SerializedRowGroupWriter<'_, W>,
    values: &[T::T],
    present: Option<&[i16]>,
) -> Result<(), ParquetError> {
    let column = rows.next_column()?;
    let mut column = column.ok_or_else(|| ParquetError::General("the schema has too few columns".to_owned()))?;
    column.typed::<T>().write_batch(values, present, None)?;
    column.close()
}
