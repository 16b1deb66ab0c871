//! The contract grows and does not change: the present descriptors against those of every released version,
//! by the rules of `buf breaking` (category WIRE_JSON; buf.build/docs/breaking/rules).

use std::collections::BTreeMap;
use std::path::Path;

use prost::Message;
use prost_types::{DescriptorProto, FieldDescriptorProto, FileDescriptorSet};

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

/// Begins what stands at a number that nothing has any more; the names that nothing may have follow.
const RESERVED: &str = "reserved";

fn reserved(names: &[String]) -> String {
    format!("{RESERVED} {}", names.join(" "))
}

/// Everything that must stay, by its place: fields and values by their numbers, methods by their names.
fn promises(set: &FileDescriptorSet) -> BTreeMap<String, String> {
    let mut all = BTreeMap::new();
    for file in &set.file {
        // Messages of map entries are nested, and follow from the field's type.
        for message in &file.message_type {
            let place = |number: i32| format!("{} {number}", message.name());
            all.insert(format!("message {}", message.name()), String::new());
            let gone = message.reserved_range.iter().flat_map(|range| range.start()..range.end());
            all.extend(gone.map(|number| (place(number), reserved(&message.reserved_name))));
            all.extend(message.field.iter().map(|field| (place(field.number()), shape(message, field))));
        }
        for one in &file.enum_type {
            let place = |number: i32| format!("{} {number}", one.name());
            let gone = one.reserved_range.iter().flat_map(|range| range.start()..=range.end());
            all.extend(gone.map(|number| (place(number), reserved(&one.reserved_name))));
            all.extend(one.value.iter().map(|value| (place(value.number()), value.name().to_owned())));
        }
        for service in &file.service {
            let place = |name: &str| format!("{} {name}", service.name());
            all.extend(service.method.iter().map(|method| (place(method.name()), format!("{method:?}"))));
        }
    }
    all
}

/// The parts of `old` that `new` breaks, in words.
fn broken(old: &FileDescriptorSet, new: &FileDescriptorSet) -> Vec<String> {
    let new = promises(new);
    let changed = |(place, was): (String, String)| {
        let name = was.split(' ').next();
        match new.get(&place) {
            Some(now) if *now == was => None,
            Some(now) if now.starts_with(RESERVED) && now.split(' ').any(|word| Some(word) == name) => None,
            Some(now) => Some(format!("{place}: {was} became {now}")),
            None => Some(format!("{place}: {was} is gone")),
        }
    };
    promises(old).into_iter().filter_map(changed).collect()
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
        (|set| message(set, "Policy").field[0].number = Some(99), "Policy 1: epsilon"),
        (|set| message(set, "Policy").field[0].name = Some("eps".to_owned()), "Policy 1: epsilon"),
        (|set| message(set, "Policy").field[0].r#type = Some(3), "Policy 1: epsilon"),
        (|set| message(set, "Policy").field[0].proto3_optional = Some(false), "Policy 1: epsilon"),
        (|set| message(set, "Outcome").field[3].oneof_index = None, "Outcome 4: failed"),
        (|set| drop(message(set, "Best").field.remove(2)), "Best 3: default_cost"),
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
            "PredictorMethod 3: PREDICTOR_METHOD_AUTO is gone",
        ),
        (
            |set| {
                let service = set.file.iter_mut().find_map(|file| file.service.first_mut());
                service.expect("the service").method[0].server_streaming = Some(true);
            },
            "TuningService CreateStudy: ",
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
    let found = broken(&grown, &reused);
    assert!(found.len() == 1 && found[0].starts_with("Policy 1: reserved "), "{found:?}");
}
