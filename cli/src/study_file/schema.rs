//! The JSON schema of study files, from the types that read them.

use schemars::generate::SchemaSettings;
use schemars::{Schema, SchemaGenerator, json_schema};
use serde_json::json;
use treewright_client::{Policy, PolicyField};

use super::{PRESET, StudyFile};

/// JSON Schema 2020-12 of a study file. Editors that know TOML use it, too.
pub(crate) fn schema() -> serde_json::Value {
    let mut schema = SchemaSettings::draft2020_12().into_generator().into_root_schema_for::<StudyFile>();
    schema.insert("title".into(), json!("Treewright study"));
    schema.to_value()
}

/// Linear: equal differences are equal steps. Log: equal ratios are.
pub(super) fn scale(_: &mut SchemaGenerator) -> Schema {
    json_schema!({ "enum": ["linear", "log"] })
}

/// The fields of a policy, from the table that the daemon decides by.
pub(super) fn policy(_: &mut SchemaGenerator) -> Schema {
    let mut properties = serde_json::Map::new();
    for field in Policy::FIELDS {
        properties.insert(field.name.to_owned(), field_schema(field));
    }
    let about = "All fields of a preset; fields that are named beside it win.";
    properties.insert(PRESET.to_owned(), json!({ "enum": Policy::PRESETS, "description": about }));
    json_schema!({
        "type": "object",
        "description": "How the service decides. What is left out takes the daemon's default.",
        "properties": properties,
        "additionalProperties": false,
    })
}

fn field_schema(field: &PolicyField) -> serde_json::Value {
    let about: Vec<&str> = field.about.lines().map(str::trim).collect();
    let description = format!("{} Unset: {}.", about.join(" ").trim(), field.unset);
    let words = (field.words)();
    if field.name == "pinned" {
        json!({ "type": "object", "description": description })
    } else if !words.is_empty() {
        json!({ "enum": words, "description": description })
    } else if field.placeholder == "BOOL" {
        json!({ "type": "boolean", "description": description })
    } else {
        json!({ "type": "number", "description": description })
    }
}
