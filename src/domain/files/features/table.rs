//! A table that is written while its rows are still being read: what is ready is taken away, so that a table of any length
//! needs the memory of a few rows.

use std::mem;

use serde::Deserialize;
use utoipa::ToSchema;

use super::parquet::ParquetTable;
use super::{COLUMNS, ExportRow};

/// Why a table could not be written.
#[derive(Debug, thiserror::Error)]
pub enum TableProblem {
    /// As CSV.
    #[error("write CSV")]
    Csv(#[from] csv::Error),
    /// As CSV, at its end.
    #[error("write CSV: {0}")]
    Flush(String),
    /// As JSON.
    #[error("write JSON")]
    Json(#[from] serde_json::Error),
    /// As Parquet.
    #[error("write Parquet")]
    Parquet(#[from] parquet::errors::ParquetError),
}

/// A way to write it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, ToSchema)]
#[serde(rename_all = "lowercase")]
pub enum TableFormat {
    /// A header and a line a row.
    Csv,
    /// `{"items":[…]}`, an object a row.
    #[default]
    Json,
    /// Apache Parquet, a row group for each part.
    Parquet,
}

/// The table so far.
pub enum FeatureTable {
    /// As CSV.
    Csv(Box<csv::Writer<Vec<u8>>>),
    /// As JSON: the text, and whether a row stands in it.
    Json(Vec<u8>, bool),
    /// As Parquet.
    Parquet(Box<ParquetTable>),
}

impl FeatureTable {
    /// An empty table.
    pub fn new(format: TableFormat) -> Result<Self, TableProblem> {
        Ok(match format {
            TableFormat::Csv => {
                let mut writer = lines();
                writer.write_record(COLUMNS)?;
                Self::Csv(Box::new(writer))
            }
            TableFormat::Json => Self::Json(br#"{"items":["#.to_vec(), false),
            TableFormat::Parquet => Self::Parquet(Box::new(ParquetTable::new()?)),
        })
    }

    /// Adds rows and takes away what is ready to be sent.
    pub fn write(&mut self, rows: &[ExportRow]) -> Result<Vec<u8>, TableProblem> {
        match self {
            Self::Csv(writer) => {
                rows.iter().try_for_each(|row| writer.serialize(row))?;
                writer.flush().map_err(|error| TableProblem::Flush(error.to_string()))?;
                mem::replace(&mut **writer, lines())
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

    /// Ends the table; the rest of it.
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

/// A writer of lines without a head: it has one already.
fn lines() -> csv::Writer<Vec<u8>> {
    csv::WriterBuilder::new().has_headers(false).from_writer(Vec::new())
}

impl TableFormat {
    /// What it is sent as.
    pub fn media_type(self) -> &'static str {
        match self {
            TableFormat::Csv => "text/csv; charset=utf-8",
            TableFormat::Json => "application/json",
            TableFormat::Parquet => "application/vnd.apache.parquet",
        }
    }

    /// How a file of it is named.
    pub fn extension(self) -> &'static str {
        match self {
            TableFormat::Csv => "csv",
            TableFormat::Json => "json",
            TableFormat::Parquet => "parquet",
        }
    }
}
