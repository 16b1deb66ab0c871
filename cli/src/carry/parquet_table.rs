//! Trials as a Parquet file (Apache Parquet format 2.6), which pandas, DuckDB, Polars and Spark read as it
//! is.
//!
//! The columns are those of the CSV form, with types, and every column may be empty in a row. The study
//! stands in the file's key-value metadata under [`STUDY_KEY`], as the first line of JSON Lines has it, so
//! that an import can create it. Files of other programs need flat columns, and no compression or Snappy.

use std::fs::File;
use std::io::Write;
use std::path::Path;
use std::sync::Arc;
use std::time::UNIX_EPOCH;

use parquet::basic::{Compression, LogicalType, Repetition, TimeUnit, Type as Physical};
use parquet::data_type::{BoolType, ByteArray, ByteArrayType, DataType, DoubleType, Int64Type};
use parquet::errors::ParquetError;
use parquet::file::metadata::KeyValue;
use parquet::file::properties::WriterProperties;
use parquet::file::reader::{FileReader, SerializedFileReader};
use parquet::file::writer::{SerializedColumnWriter, SerializedFileWriter};
use parquet::record::Field;
use parquet::schema::types::Type;
use treewright_client::{StudySpec, TrialRecord, Value};

use super::CarriedTrial;
use super::jsonl::Header;
use super::table::{self, Kind, MEASUREMENT, Role, Row, TrialCell, TrialColumn};
use crate::failure::{Failure, Result};

/// Where the study stands in the file's metadata.
const STUDY_KEY: &str = "treewright_study";
/// Trials that are written at a time: readers may skip the rest.
const ROW_GROUP: usize = 100_000;

pub(crate) fn write(
    out: impl Write + Send,
    header: &Header,
    spec: &StudySpec,
    trials: impl Iterator<Item = Result<TrialRecord>>,
) -> Result<()> {
    // Which measurements there are is only known at the end.
    let trials: Vec<TrialRecord> = trials.collect::<Result<_, _>>()?;
    let columns = table::columns(spec, &trials, &header.site);
    let study = KeyValue::new(STUDY_KEY.to_owned(), serde_json::to_string(header)?);
    let properties = WriterProperties::builder()
        .set_compression(Compression::SNAPPY)
        .set_key_value_metadata(Some(vec![study]))
        .build();
    write_columns(out, &columns, &trials, properties)
        .map_err(|error| Failure::Output(std::io::Error::other(error)))
}

fn write_columns(
    out: impl Write + Send,
    columns: &[TrialColumn],
    trials: &[TrialRecord],
    properties: WriterProperties,
) -> Result<(), ParquetError> {
    let fields = columns.iter().map(|column| Ok(Arc::new(field(column)?)));
    let schema = Type::group_type_builder("trials").with_fields(fields.collect::<Result<_, ParquetError>>()?);
    let mut file = SerializedFileWriter::new(out, Arc::new(schema.build()?), Arc::new(properties))?;
    for trials in trials.chunks(ROW_GROUP) {
        let mut group = file.next_row_group()?;
        for column in columns {
            let Some(mut writer) = group.next_column()? else { break };
            write_cells(&mut writer, column.kind, trials.iter().map(|trial| column.of(trial)))?;
            writer.close()?;
        }
        group.close()?;
    }
    file.close().map(drop)
}

fn field(column: &TrialColumn) -> Result<Type, ParquetError> {
    let (physical, logical) = match column.kind {
        Kind::Boolean => (Physical::BOOLEAN, None),
        Kind::Integer => (Physical::INT64, None),
        Kind::Number => (Physical::DOUBLE, None),
        Kind::Text => (Physical::BYTE_ARRAY, Some(LogicalType::String)),
        Kind::Time => (Physical::INT64, Some(LogicalType::timestamp(true, TimeUnit::MILLIS))),
    };
    let field = Type::primitive_type_builder(&column.title, physical);
    field.with_logical_type(logical).with_repetition(Repetition::OPTIONAL).build()
}

fn write_cells(
    writer: &mut SerializedColumnWriter<'_>,
    kind: Kind,
    cells: impl Iterator<Item = Option<TrialCell>>,
) -> Result<(), ParquetError> {
    match kind {
        Kind::Boolean => put::<BoolType>(writer, cells.map(|cell| cell.and_then(boolean))),
        Kind::Integer | Kind::Time => put::<Int64Type>(writer, cells.map(|cell| cell.and_then(integer))),
        Kind::Number => put::<DoubleType>(writer, cells.map(|cell| cell.and_then(number))),
        Kind::Text => put::<ByteArrayType>(writer, cells.map(|cell| cell.and_then(text))),
    }
}

fn put<T: DataType>(
    writer: &mut SerializedColumnWriter<'_>,
    cells: impl Iterator<Item = Option<T::T>>,
) -> Result<(), ParquetError> {
    let cells: Vec<Option<T::T>> = cells.collect();
    // Definition levels of a flat optional column: 1 where there is a value.
    let levels: Vec<i16> = cells.iter().map(|cell| i16::from(cell.is_some())).collect();
    let values: Vec<T::T> = cells.into_iter().flatten().collect();
    writer.typed::<T>().write_batch(&values, Some(&levels), None).map(drop)
}

fn boolean(cell: TrialCell) -> Option<bool> {
    if let TrialCell::Boolean(value) = cell { Some(value) } else { None }
}

/// Times are milliseconds since 1970.
fn integer(cell: TrialCell) -> Option<i64> {
    match cell {
        TrialCell::Integer(value) => Some(value),
        TrialCell::Time(value) => value.duration_since(UNIX_EPOCH).ok()?.as_millis().try_into().ok(),
        _ => None,
    }
}

fn number(cell: TrialCell) -> Option<f64> {
    match cell {
        TrialCell::Number(value) => Some(value),
        TrialCell::Integer(value) => Some(value as f64),
        _ => None,
    }
}

fn text(cell: TrialCell) -> Option<ByteArray> {
    if let TrialCell::Text(value) = cell { Some(value.into_bytes().into()) } else { None }
}

/// Reads trials, and the study where an export wrote it.
pub(crate) fn read(path: &Path) -> Result<(Option<Header>, Vec<CarriedTrial>)> {
    let file = File::open(path).map_err(|error| Failure::file(path, error.to_string()))?;
    let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
    // The library asserts what a damaged file may deny.
    let parsed = std::panic::catch_unwind(|| parse(file, &name));
    let parsed = parsed.unwrap_or_else(|_| Err("the file is damaged".to_owned()));
    parsed.map_err(|problem| Failure::file(path, problem))
}

fn parse(file: File, name: &str) -> Result<(Option<Header>, Vec<CarriedTrial>), String> {
    let words =
        |error: ParquetError| format!("{error}; files without compression or with Snappy can be read");
    let file = SerializedFileReader::new(file).map_err(|error| error.to_string())?;
    let metadata = file.metadata().file_metadata();
    let study = metadata.key_value_metadata().into_iter().flatten().find(|pair| pair.key == STUDY_KEY);
    let study = study.and_then(|pair| pair.value.as_deref()).map(Header::parse).transpose()?;
    let (wanted, roles) = wanted(metadata.schema())?;
    if !roles.iter().any(|role| matches!(role, Role::Measurement(_))) {
        return Err(format!("it has no column {MEASUREMENT}NAME"));
    }
    let mut trials = Vec::new();
    for (index, record) in file.get_row_iter(Some(wanted)).map_err(words)?.enumerate() {
        let number = index + 1;
        let mut row = Row::new(name, number);
        for (role, (title, field)) in roles.iter().zip(record.map_err(words)?.get_column_iter()) {
            let taken = match value(field) {
                // Of a parameter it may be a choice.
                Some(Value::Text(text)) if text.is_empty() && !matches!(role, Role::Configuration(_)) => {
                    continue;
                }
                Some(value) => row.take(role, value),
                None if *field == Field::Null => continue,
                None => Err(format!("column {title} holds neither numbers, text nor true and false")),
            };
            taken.map_err(|problem| format!("row {number}: {problem}"))?;
        }
        trials.extend(row.trial().map_err(|problem| format!("row {number}: {problem}"))?);
    }
    Ok((study, trials))
}

/// The part of a file that an import needs, and what each of its columns holds.
fn wanted(schema: &Type) -> Result<(Type, Vec<Role>), String> {
    let mut fields = Vec::new();
    let mut roles = Vec::new();
    for field in schema.get_fields() {
        let Some(role) = Role::of(field.name()) else { continue };
        if !field.is_primitive() || field.get_basic_info().repetition() == Repetition::REPEATED {
            return Err(format!("column {} is not flat", field.name()));
        }
        fields.push(Arc::clone(field));
        roles.push(role);
    }
    let part = Type::group_type_builder(schema.name()).with_fields(fields).build();
    Ok((part.map_err(|error| error.to_string())?, roles))
}

fn value(field: &Field) -> Option<Value> {
    Some(match field {
        Field::Bool(value) => Value::Boolean(*value),
        Field::Byte(value) => Value::Integer((*value).into()),
        Field::Short(value) => Value::Integer((*value).into()),
        Field::Int(value) => Value::Integer((*value).into()),
        Field::Long(value) => Value::Integer(*value),
        Field::UByte(value) => Value::Integer((*value).into()),
        Field::UShort(value) => Value::Integer((*value).into()),
        Field::UInt(value) => Value::Integer((*value).into()),
        Field::ULong(value) => Value::Integer((*value).try_into().ok()?),
        Field::Float(value) => Value::Float((*value).into()),
        Field::Double(value) => Value::Float(*value),
        Field::Str(value) => Value::Text(value.clone()),
        _ => return None,
    })
}
