//! Trajectory → Parquet: the same table for column-based programs (pandas, DuckDB, Arrow).
//!
//! Uses the low-level writer: flat columns need no Arrow. Names are UTF-8 strings, absent numbers
//! are nulls, pages are compressed with Snappy.

use std::io;
use std::sync::Arc;

use parquet::basic::Compression;
use parquet::data_type::{ByteArray, ByteArrayType, DataType, DoubleType, Int64Type};
use parquet::errors::ParquetError;
use parquet::file::properties::WriterProperties;
use parquet::file::writer::{SerializedFileWriter, SerializedRowGroupWriter};
use parquet::schema::parser::parse_message_type;

use super::columns::number;
use super::rows::BoxedRows;
use super::{COLUMNS, REQUIRED_COLUMNS, state_name};
use crate::domain::files::parquet_sink::ParquetSink;
use crate::vision::trajectory::Sample;

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
    /// The rows cannot be read.
    #[error(transparent)]
    Rows(#[from] io::Error),
    /// The Parquet writer failed.
    #[error("write Parquet")]
    Write(#[from] ParquetError),
}

/// Rows of a row group; in memory they take 1.6 MiB.
const ROWS_PER_GROUP: usize = 8_192;

/// Pieces of a Parquet file, one for each row group; the rows are read once.
pub struct ParquetPieces {
    rows: BoxedRows,
    /// `None` once the file has ended.
    file: Option<SerializedFileWriter<ParquetSink>>,
    sink: ParquetSink,
}

impl ParquetPieces {
    /// The file of these rows.
    ///
    /// # Errors
    /// The Parquet writer fails.
    pub fn new(mut rows: BoxedRows) -> Result<Self, ParquetProblem> {
        rows.rewind();
        let properties = WriterProperties::builder().set_compression(Compression::SNAPPY).build();
        let (sink, schema) = (ParquetSink::default(), Arc::new(parse_message_type(SCHEMA)?));
        let file = SerializedFileWriter::new(sink.clone(), schema, Arc::new(properties))?;
        Ok(Self { rows, file: Some(file), sink })
    }

    fn write_piece(&mut self, mut file: SerializedFileWriter<ParquetSink>) -> Result<Vec<u8>, ParquetProblem> {
        let mut rows = Vec::new();
        while rows.len() < ROWS_PER_GROUP
            && let Some(row) = self.rows.next_row()?
        {
            rows.push(row);
        }
        if !rows.is_empty() {
            let mut group = file.next_row_group()?;
            write_columns(&mut group, self.rows.tools(), &rows)?;
            group.close()?;
        }
        if rows.len() == ROWS_PER_GROUP {
            self.file = Some(file);
        } else {
            file.close()?;
        }
        Ok(self.sink.take())
    }
}

impl Iterator for ParquetPieces {
    type Item = io::Result<Vec<u8>>;

    fn next(&mut self) -> Option<Self::Item> {
        let file = self.file.take()?;
        Some(self.write_piece(file).map_err(io::Error::other))
    }
}

/// Writes the columns in the schema's order, which is that of the table: the format identifies columns by position.
fn write_columns(
    group: &mut SerializedRowGroupWriter<'_, ParquetSink>,
    tools: &[String],
    rows: &[Sample],
) -> Result<(), ParquetProblem> {
    let names: Vec<ByteArray> = tools.iter().map(|name| ByteArray::from(name.as_str())).collect();
    for (column, name) in COLUMNS.iter().enumerate() {
        match *name {
            "frame" => {
                let frame =
                    |row: &Sample| i64::try_from(row.frame).map_err(|_| ParquetProblem::FrameTooLarge(row.frame));
                let frames = rows.iter().map(frame).collect::<Result<Vec<_>, _>>()?;
                write::<Int64Type>(group, &frames, None)?;
            }
            "tool" => {
                let name = |row: &Sample| names.get(row.tool).cloned().ok_or(ParquetProblem::UnknownTool(row.tool));
                write::<ByteArrayType>(group, &rows.iter().map(name).collect::<Result<Vec<_>, _>>()?, None)?;
            }
            "state" => {
                let states: Vec<ByteArray> = rows.iter().map(|row| ByteArray::from(state_name(row.state))).collect();
                write::<ByteArrayType>(group, &states, None)?;
            }
            _ => {
                let values: Vec<f64> = rows.iter().filter_map(|row| number(row, column)).collect();
                let present: Vec<i16> = rows.iter().map(|row| i16::from(number(row, column).is_some())).collect();
                let is_required = column < REQUIRED_COLUMNS;
                write::<DoubleType>(group, &values, (!is_required).then_some(present.as_slice()))?;
            }
        }
    }
    Ok(())
}

fn write<T: DataType>(
    group: &mut SerializedRowGroupWriter<'_, ParquetSink>,
    values: &[T::T],
    present: Option<&[i16]>,
) -> Result<(), ParquetError> {
    let column = group.next_column()?;
    let mut column = column.ok_or_else(|| ParquetError::General("the schema has too few columns".to_owned()))?;
    column.typed::<T>().write_batch(values, present, None)?;
    column.close()
}
