//! The contract grows and does not change: the present descriptors against those of every released version,
//! by the rules of `buf breaking` (category WIRE_JSON; buf.build/docs/breaking/rules).

use std::collections::BTreeMap;
use std::path::Path;

use prost::Message;
use prost_types::{
    DescriptorProto, EnumDescriptorProto, FieldDescriptorProto, FileDescriptorSet, ServiceDescriptorProto,
};

fn present() -> FileDescriptorSet {
    let mut all =
        FileDescriptorSet::decode(treewright_proto::FILE_DESCRIPTOR_SET).expect("our own descriptors");
    all.file.retain(|file| file.package() == "treewright.v1");
    all
}

/// The descriptors of each released version.
fn released() -> Vec<(String, FileDescriptorSet)> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("released");
    let entries = std::fs::read_dir(folder).expect("the folder of released versions");
    let folders = entries.map(|entry| entry.expect("an entry").path()).filter(|path| path.is_dir());
    folders
        .map(|path| {
            let bytes = std::fs::read(path.join("descriptors.binpb")).expect("recorded descriptors");
            let version = path.file_name().expect("a name").to_string_lossy().into_owned();
            (version, FileDescriptorSet::decode(bytes.as_slice()).expect("descriptors"))
        })
        .collect()
}

fn messages(set: &FileDescriptorSet) -> BTreeMap<&str, &DescriptorProto> {
    // Messages of map entries are nested, and follow from the field's type.
    set.file.iter().flat_map(|file| &file.message_type).map(|message| (message.name(), message)).collect()
}

fn enums(set: &FileDescriptorSet) -> BTreeMap<&str, &EnumDescriptorProto> {
    set.file.iter().flat_map(|file| &file.enum_type).map(|one| (one.name(), one)).collect()
}

fn services(set: &FileDescriptorSet) -> BTreeMap<&str, &ServiceDescriptorProto> {
    set.file.iter().flat_map(|file| &file.service).map(|service| (service.name(), service)).collect()
}

/// The parts of `old` that `new` breaks, in words.
fn broken(old: &FileDescriptorSet, new: &FileDescriptorSet) -> Vec<String> {
    let mut found = Vec::new();
    let new_messages = messages(new);
    for (name, message) in messages(old) {
        match new_messages.get(name) {
            None => found.push(format!("message {name} is gone")),
            Some(now) => broken_message(name, message, now, &mut found),
        }
    }
    let new_enums = enums(new);
    for (name, one) in enums(old) {
        match new_enums.get(name) {
            None => found.push(format!("enum {name} is gone")),
            Some(now) => broken_enum(name, one, now, &mut found),
        }
    }
    let new_services = services(new);
    for (name, service) in services(old) {
        match new_services.get(name) {
            None => found.push(format!("service {name} is gone")),
            Some(now) => broken_service(name, service, now, &mut found),
        }
    }
    found
}

/// The properties of a field that both sides must agree on.
fn shape(message: &DescriptorProto, field: &FieldDescriptorProto) -> String {
    let oneof = match field.oneof_index {
        Some(index) if !field.proto3_optional() => message.oneof_decl[index as usize].name(),
        _ => "",
    };
    let entry = message.nested_type.iter().find(|nested| {
        nested.options.as_ref().is_some_and(prost_types::MessageOptions::map_entry)
            && field.type_name().ends_with(&format!(".{}", nested.name()))
    });
    // Two entries of one name may hold other types.
    let entry = entry.map(|entry| entry.field.iter().map(|one| shape(entry, one)).collect::<Vec<_>>());
    format!(
        "{} {:?} {:?} {} optional={} oneof={oneof} {entry:?}",
        field.name(),
        field.label(),
        field.r#type(),
        field.type_name(),
        field.proto3_optional()
    )
}

fn broken_message(name: &str, old: &DescriptorProto, new: &DescriptorProto, found: &mut Vec<String>) {
    let is_reserved = |number: i32| new.reserved_range.iter().any(|r| (r.start()..r.end()).contains(&number));
    for field in &old.field {
        let number = field.number();
        match new.field.iter().find(|now| now.number() == number) {
            Some(now) if shape(old, field) != shape(new, now) => {
                found.push(format!("{name} {number}: {} became {}", shape(old, field), shape(new, now)));
            }
            Some(_) => {}
            None if is_reserved(number) && new.reserved_name.iter().any(|one| one == field.name()) => {}
            None => found.push(format!("{name}.{} ({number}) is gone and not reserved", field.name())),
        }
    }
    for range in &old.reserved_range {
        for number in range.start()..range.end() {
            if !is_reserved(number) {
                found.push(format!("{name}: {number} is no longer reserved"));
            }
        }
    }
}

fn broken_enum(name: &str, old: &EnumDescriptorProto, new: &EnumDescriptorProto, found: &mut Vec<String>) {
    let is_reserved =
        |number: i32| new.reserved_range.iter().any(|r| (r.start()..=r.end()).contains(&number));
    for value in &old.value {
        let number = value.number();
        match new.value.iter().find(|now| now.number() == number) {
            Some(now) if now.name() != value.name() => {
                found.push(format!("{name} {number}: {} became {}", value.name(), now.name()));
            }
            Some(_) => {}
            None if is_reserved(number) && new.reserved_name.iter().any(|one| one == value.name()) => {}
            None => found.push(format!("{name}: {} ({number}) is gone and not reserved", value.name())),
        }
    }
    for range in &old.reserved_range {
        for number in range.start()..=range.end() {
            if !is_reserved(number) {
                found.push(format!("{name}: {number} is no longer reserved"));
            }
        }
    }
}

fn broken_service(
    name: &str,
    old: &ServiceDescriptorProto,
    new: &ServiceDescriptorProto,
    found: &mut Vec<String>,
) {
    for method in &old.method {
        match new.method.iter().find(|now| now.name() == method.name()) {
            Some(now) if now != method => found.push(format!("{name}.{} has changed", method.name())),
            Some(_) => {}
            None => found.push(format!("{name}.{} is gone", method.name())),
        }
    }
}

#[test]
fn nothing_that_was_released_has_changed() {
    let released = released();
    assert!(released.iter().any(|(version, _)| version == "0.1.0"));
    for (version, old) in released {
        let found = broken(&old, &present());
        assert!(found.is_empty(), "against {version}:\n{}", found.join("\n"));
    }
}

/// The message of that name, to be changed.
fn message<'a>(set: &'a mut FileDescriptorSet, name: &str) -> &'a mut DescriptorProto {
    let mut all = set.file.iter_mut().flat_map(|file| &mut file.message_type);
    all.find(|message| message.name() == name).expect("a message of the contract")
}

#[test]
fn every_kind_of_break_is_found() {
    type Change = fn(&mut FileDescriptorSet);
    let cases: [(Change, &str); 9] = [
        (|set| message(set, "Policy").field[0].number = Some(99), "Policy.epsilon (1) is gone"),
        (|set| message(set, "Policy").field[0].name = Some("eps".to_owned()), "Policy 1: epsilon"),
        (|set| message(set, "Policy").field[0].r#type = Some(3), "Policy 1: epsilon"),
        (|set| message(set, "Policy").field[0].proto3_optional = Some(false), "Policy 1: epsilon"),
        (|set| message(set, "Outcome").field[3].oneof_index = None, "Outcome 4: failed"),
        (|set| drop(message(set, "Best").field.remove(2)), "Best.default_cost (3) is gone and not reserved"),
        (
            |set| {
                let trial = message(set, "Trial");
                let entry = trial.nested_type.iter_mut().find(|one| one.name() == "IndicatorsEntry");
                entry.expect("a map").field[1].r#type = Some(9);
            },
            "Trial 4: indicators",
        ),
        (
            |set| {
                let mut all = set.file.iter_mut().flat_map(|file| &mut file.enum_type);
                let methods = all.find(|one| one.name() == "PredictorMethod").expect("an enum");
                methods.value[3].number = Some(8);
            },
            "PredictorMethod: PREDICTOR_METHOD_AUTO (3) is gone and not reserved",
        ),
        (
            |set| {
                let service = set.file.iter_mut().find_map(|file| file.service.first_mut());
                service.expect("the service").method[0].server_streaming = Some(true);
            },
            "TuningService.CreateStudy has changed",
        ),
    ];
    for (change, words) in cases {
        let mut changed = present();
        change(&mut changed);
        let found = broken(&present(), &changed);
        assert!(found.iter().any(|one| one.contains(words)), "{words:?} is not in {found:?}");
    }
}

#[test]
fn what_is_added_or_retired_with_a_reservation_breaks_nothing() {
    let mut grown = present();
    let policy = message(&mut grown, "Policy");
    let retired = policy.field.remove(0);
    policy.reserved_name.push(retired.name().to_owned());
    policy.reserved_range.push(prost_types::descriptor_proto::ReservedRange { start: Some(1), end: Some(2) });
    let added = FieldDescriptorProto { number: Some(99), name: Some("new".to_owned()), ..retired };
    policy.field.push(added);
    assert_eq!(broken(&present(), &grown), Vec::<String>::new());
    let mut reused = grown.clone();
    message(&mut reused, "Policy").reserved_range.pop();
    assert_eq!(broken(&grown, &reused), ["Policy: 1 is no longer reserved"]);
}

#[test]
fn policies_are_those_of_the_model() {
    use treewright_model::policy::PolicySettings;
    let set = present();
    let mut on_wire: Vec<&str> = messages(&set)["Policy"].field.iter().map(|field| field.name()).collect();
    let mut in_table: Vec<&str> = PolicySettings::FIELDS.iter().map(|field| field.name).collect();
    on_wire.sort_unstable();
    in_table.sort_unstable();
    assert_eq!(on_wire, in_table);
}
