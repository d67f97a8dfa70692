//! A table that is written while its rows are still being read. Finished bytes are taken out at once, so that a table
//! of any length needs memory for a few rows only.

use std::mem;

use serde::Deserialize;
use utoipa::ToSchema;

use super::parquet::ParquetTable;
use super::{COLUMNS, ExportRow};

/// Why a table could not be written.
#[derive(Debug, thiserror::Error)]
pub enum TableProblem {
    /// Writing CSV failed.
    #[error("write CSV")]
    Csv(#[from] csv::Error),
    /// Flushing CSV failed.
    #[error("write CSV: {0}")]
    Flush(String),
    /// Writing JSON failed.
    #[error("write JSON")]
    Json(#[from] serde_json::Error),
    /// Writing Parquet failed.
    #[error("write Parquet")]
    Parquet(#[from] parquet::errors::ParquetError),
}

/// File format of a table.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, ToSchema)]
#[serde(rename_all = "lowercase")]
pub enum TableFormat {
    /// A header, then one line per row.
    Csv,
    /// `{"items":[…]}`, one object per row.
    #[default]
    Json,
    /// Apache Parquet, a row group for each batch.
    Parquet,
}

/// A table being written.
pub enum FeatureTable {
    /// As CSV.
    Csv(Box<csv::Writer<Vec<u8>>>),
    /// As JSON: the text, and whether any row has been written.
    Json(Vec<u8>, bool),
    /// As Parquet.
    Parquet(Box<ParquetTable>),
}

impl FeatureTable {
    /// An empty table.
    pub fn new(format: TableFormat) -> Result<Self, TableProblem> {
        Ok(match format {
            TableFormat::Csv => {
                let mut writer = csv_writer();
                writer.write_record(COLUMNS)?;
                Self::Csv(Box::new(writer))
            }
            TableFormat::Json => Self::Json(br#"{"items":["#.to_vec(), false),
            TableFormat::Parquet => Self::Parquet(Box::new(ParquetTable::new()?)),
        })
    }

    /// Adds rows and returns the bytes that are ready to be sent.
    pub fn write(&mut self, rows: &[ExportRow]) -> Result<Vec<u8>, TableProblem> {
        match self {
            Self::Csv(writer) => {
                rows.iter().try_for_each(|row| writer.serialize(row.without_formulas()))?;
                writer.flush().map_err(|error| TableProblem::Flush(error.to_string()))?;
                mem::replace(&mut **writer, csv_writer())
                    .into_inner()
                    .map_err(|error| TableProblem::Flush(error.to_string()))
            }
            Self::Json(text, has_rows) => {
                for row in rows {
                    if mem::replace(has_rows, true) {
                        text.push(b',');
                    }
                    serde_json::to_writer(&mut *text, row)?;
                }
                Ok(mem::take(text))
            }
            Self::Parquet(table) => Ok(table.write(rows)?),
        }
    }

    /// Ends the table and returns the remaining bytes.
    pub fn finish(self) -> Result<Vec<u8>, TableProblem> {
        match self {
            Self::Csv(writer) => writer.into_inner().map_err(|error| TableProblem::Flush(error.to_string())),
            Self::Json(mut text, _) => {
                text.extend(b"]}");
                Ok(text)
            }
            Self::Parquet(table) => Ok(table.finish()?),
        }
    }
}

/// A CSV writer without a header, which has been written already.
fn csv_writer() -> csv::Writer<Vec<u8>> {
    csv::WriterBuilder::new().has_headers(false).from_writer(Vec::new())
}

impl TableFormat {
    /// The format's media type.
    pub fn media_type(self) -> &'static str {
        match self {
            TableFormat::Csv => "text/csv; charset=utf-8",
            TableFormat::Json => "application/json",
            TableFormat::Parquet => "application/vnd.apache.parquet",
        }
    }

    /// The format's file name extension.
    pub fn extension(self) -> &'static str {
        match self {
            TableFormat::Csv => "csv",
            TableFormat::Json => "json",
            TableFormat::Parquet => "parquet",
        }
    }
}
