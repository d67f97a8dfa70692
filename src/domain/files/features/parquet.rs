//! Features → Parquet, for column-based programs (pandas, DuckDB, Arrow): one row group for each batch of rows.

use std::sync::Arc;

use parquet::basic::Compression;
use parquet::data_type::{ByteArray, ByteArrayType, DataType, DoubleType};
use parquet::errors::ParquetError;
use parquet::file::properties::WriterProperties;
use parquet::file::writer::{SerializedFileWriter, SerializedRowGroupWriter};
use parquet::schema::parser::parse_message_type;

use super::ExportRow;
use crate::domain::files::parquet_sink::ParquetSink;

const SCHEMA: &str = "message features {
    REQUIRED BYTE_ARRAY session (STRING);
    REQUIRED BYTE_ARRAY trainee (STRING);
    REQUIRED BYTE_ARRAY task (STRING);
    REQUIRED BYTE_ARRAY box (STRING);
    REQUIRED BYTE_ARRAY recorded_at (STRING);
    OPTIONAL BYTE_ARRAY tracker (STRING);
    OPTIONAL BYTE_ARRAY verdict (STRING);
    REQUIRED BYTE_ARRAY feature (STRING);
    OPTIONAL BYTE_ARRAY tool (STRING);
    REQUIRED BYTE_ARRAY space (STRING);
    REQUIRED BYTE_ARRAY unit (STRING);
    OPTIONAL DOUBLE value;
    OPTIONAL DOUBLE low;
    OPTIONAL DOUBLE high;
    OPTIONAL BYTE_ARRAY not_enough (STRING);
    OPTIONAL BYTE_ARRAY no_error (STRING);
    REQUIRED BYTE_ARRAY pipeline (STRING);
    OPTIONAL BYTE_ARRAY tracked_with (STRING);
    OPTIONAL BYTE_ARRAY calibration (STRING);
    OPTIONAL BYTE_ARRAY palette (STRING);
    OPTIONAL BYTE_ARRAY model (STRING);
    OPTIONAL BYTE_ARRAY too_uncertain (STRING);
}";

/// A Parquet file that is written in batches.
pub struct ParquetTable {
    file: SerializedFileWriter<ParquetSink>,
    sink: ParquetSink,
}

impl ParquetTable {
    pub(super) fn new() -> Result<Self, ParquetError> {
        let properties = WriterProperties::builder().set_compression(Compression::SNAPPY).build();
        let sink = ParquetSink::default();
        let schema = Arc::new(parse_message_type(SCHEMA)?);
        Ok(Self { file: SerializedFileWriter::new(sink.clone(), schema, Arc::new(properties))?, sink })
    }

    pub(super) fn write(&mut self, rows: &[ExportRow]) -> Result<Vec<u8>, ParquetError> {
        if !rows.is_empty() {
            let mut group = self.file.next_row_group()?;
            write_columns(&mut group, rows)?;
            group.close()?;
        }
        Ok(self.sink.take())
    }

    pub(super) fn finish(self) -> Result<Vec<u8>, ParquetError> {
        self.file.close()?;
        Ok(self.sink.take())
    }
}

/// Writes the columns in the schema's order: the format identifies columns by position.
fn write_columns(
    group: &mut SerializedRowGroupWriter<'_, ParquetSink>,
    rows: &[ExportRow],
) -> Result<(), ParquetError> {
    write_required(group, rows, |row| &row.session)?;
    write_required(group, rows, |row| &row.trainee)?;
    write_required(group, rows, |row| &row.task)?;
    write_required(group, rows, |row| &row.in_box)?;
    write_required(group, rows, |row| &row.recorded_at)?;
    write_optional(group, rows, |row| row.tracker.as_deref())?;
    write_optional(group, rows, |row| row.verdict.as_deref())?;
    write_required(group, rows, |row| &row.feature)?;
    write_optional(group, rows, |row| row.tool.as_deref())?;
    write_required(group, rows, |row| row.space)?;
    write_required(group, rows, |row| &row.unit)?;
    for number in [|row: &ExportRow| row.value, |row: &ExportRow| row.low, |row: &ExportRow| row.high] {
        let (values, present) = split_present(rows, number);
        write::<DoubleType>(group, &values, Some(&present))?;
    }
    write_optional(group, rows, |row| row.not_enough.as_deref())?;
    write_optional(group, rows, |row| row.no_error.as_deref())?;
    write_required(group, rows, |row| &row.pipeline)?;
    write_optional(group, rows, |row| row.tracked_with.as_deref())?;
    write_optional(group, rows, |row| row.calibration.as_deref())?;
    write_optional(group, rows, |row| row.palette.as_deref())?;
    write_optional(group, rows, |row| row.model.as_deref())?;
    write_optional(group, rows, |row| row.too_uncertain)
}

fn write_required(
    group: &mut SerializedRowGroupWriter<'_, ParquetSink>,
    rows: &[ExportRow],
    of: impl Fn(&ExportRow) -> &str,
) -> Result<(), ParquetError> {
    let values: Vec<ByteArray> = rows.iter().map(|row| ByteArray::from(of(row))).collect();
    write::<ByteArrayType>(group, &values, None)
}

fn write_optional(
    group: &mut SerializedRowGroupWriter<'_, ParquetSink>,
    rows: &[ExportRow],
    of: impl Fn(&ExportRow) -> Option<&str>,
) -> Result<(), ParquetError> {
    let (values, present) = split_present(rows, |row| of(row).map(ByteArray::from));
    write::<ByteArrayType>(group, &values, Some(&present))
}

fn split_present<T>(rows: &[ExportRow], of: impl Fn(&ExportRow) -> Option<T>) -> (Vec<T>, Vec<i16>) {
    let present = rows.iter().map(|row| i16::from(of(row).is_some())).collect();
    (rows.iter().filter_map(of).collect(), present)
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
