//! A glTF file's JSON before its parser sees it: the parser is stricter than the format, and silent about
//! skipped content.
//!
//! Optional parts are put in, parts that are never drawn are taken out, and each kind of content that is
//! missing in the picture gets a note of one sentence. After that the parser's own checks are about faults.

use std::collections::BTreeMap;

use gltf::binary::Glb;
use serde_json::{Value, json};

use super::{error::one_line, text};

/// A document ready for the parser.
#[derive(Debug)]
pub(super) struct Document {
    pub(super) json: Value,
    /// The binary chunk.
    pub(super) blob: Option<Vec<u8>>,
    /// One sentence for each kind of thing that is left out.
    pub(super) notes: Vec<String>,
}

#[derive(Debug, PartialEq)]
pub(super) enum Refusal {
    /// It does not follow the format.
    Malformed(String),
    /// The name of a required extension that is not read.
    Unsupported(String),
}

/// Bytes of the header of a binary file.
const GLB_HEADER_BYTES: u32 = 12;

/// Extensions that are read.
const READ: [&str; 6] = [
    "KHR_lights_punctual",
    "KHR_materials_emissive_strength",
    "KHR_materials_ior",
    "KHR_materials_transmission",
    "KHR_materials_volume",
    "KHR_texture_transform",
];

/// Extensions that change nothing in the picture, or whose traces get a note.
const NOTED_ELSEWHERE: [&str; 9] = [
    "KHR_draco_mesh_compression",
    "EXT_meshopt_compression",
    "KHR_texture_basisu",
    "EXT_texture_webp",
    "EXT_texture_avif",
    "MSFT_texture_dds",
    "KHR_materials_pbrSpecularGlossiness",
    "EXT_mesh_gpu_instancing",
    "KHR_xmp_json_ld",
];

/// Extensions without which there is no geometry.
const GEOMETRY: [&str; 3] =
    ["KHR_draco_mesh_compression", "EXT_meshopt_compression", "KHR_meshopt_compression"];

pub(super) fn read(bytes: &[u8]) -> Result<Document, Refusal> {
    let (text, blob) = if bytes.starts_with(b"glTF") {
        check_header(bytes)?;
        let glb = Glb::from_slice(bytes).map_err(|error| Refusal::Malformed(one_line(&error.to_string())))?;
        (glb.json, glb.bin.map(|data| data.into_owned()))
    } else {
        (text::decoded(bytes).into_owned().into_bytes().into(), None)
    };
    let parsed = serde_json::from_slice::<Value>(text::without_mark(&text));
    let json = parsed.map_err(|error| Refusal::Malformed(one_line(&error.to_string())))?;
    if !json.is_object() {
        return Err(Refusal::Malformed("its JSON is no object".to_owned()));
    }
    check_version(&json)?;
    let mut document = Document { json, blob, notes: Vec::new() };
    document.check_required()?;
    document.tell_extensions();
    document.scenes();
    document.animations();
    document.deformations();
    document.materials();
    document.textures();
    document.primitives();
    Ok(document)
}

/// A binary file says its own version and length; a shorter one was cut off on the way.
fn check_header(bytes: &[u8]) -> Result<(), Refusal> {
    let word = |place: usize| {
        bytes.get(place..place + 4).and_then(|word| word.try_into().ok()).map(u32::from_le_bytes)
    };
    let malformed = |cause: String| Err(Refusal::Malformed(cause));
    match (word(4), word(8)) {
        (Some(version), _) if version != 2 => unsupported_version(&format!("{version}")),
        (_, None) => malformed(format!("it is cut off after {} bytes, in its header", bytes.len())),
        (_, Some(length)) if length < GLB_HEADER_BYTES => {
            malformed(format!("its header says it is only {length} bytes long"))
        }
        (_, Some(length)) if length as usize > bytes.len() => {
            malformed(format!("it is cut off: {length} bytes were announced, {} are there", bytes.len()))
        }
        _ => Ok(()),
    }
}

fn unsupported_version(version: &str) -> Result<(), Refusal> {
    Err(Refusal::Unsupported(format!("version {version} of glTF (2.0 is read)")))
}

fn check_version(json: &Value) -> Result<(), Refusal> {
    let said = |key: &str| json.pointer(key).and_then(Value::as_str);
    match (said("/asset/version"), said("/asset/minVersion")) {
        (None, _) => {
            Err(Refusal::Malformed("it does not say its version of glTF (asset.version)".to_owned()))
        }
        (_, Some(version)) if version != "2.0" => unsupported_version(version),
        (Some(version), _) if !version.starts_with("2.") => unsupported_version(version),
        _ => Ok(()),
    }
}

/// The members of a list; none where there is no such list.
fn list<'a>(json: &'a Value, key: &str) -> &'a [Value] {
    json.get(key).and_then(Value::as_array).map_or(&[], Vec::as_slice)
}

fn list_mut<'a>(json: &'a mut Value, key: &str) -> impl Iterator<Item = &'a mut Value> {
    json.get_mut(key).and_then(Value::as_array_mut).into_iter().flatten()
}

/// The members with a key, taken out.
fn take(json: &mut Value, key: &str) -> Option<Value> {
    json.as_object_mut().and_then(|object| object.remove(key))
}

fn index(value: &Value, key: &str) -> Option<usize> {
    value.get(key).and_then(Value::as_u64).map(|number| number as usize)
}

/// Whether the value of a key is a number below a count.
fn is_in(value: &Value, key: &str, count: usize) -> bool {
    index(value, key).is_some_and(|found| found < count)
}

impl Document {
    fn note(&mut self, count: usize, what: &str) {
        self.notes.extend(text::counted(count, what));
    }

    /// Refuses a file that needs an extension to be drawn; other required ones get a note.
    fn check_required(&mut self) -> Result<(), Refusal> {
        let required: Vec<String> = list(&self.json, "extensionsRequired")
            .iter()
            .filter_map(|name| name.as_str().map(str::to_owned))
            .collect();
        if let Some(name) = required.iter().find(|name| GEOMETRY.contains(&name.as_str())) {
            return Err(Refusal::Unsupported(format!("the required extension {name}")));
        }
        let known = |name: &String| READ.contains(&name.as_str()) || NOTED_ELSEWHERE.contains(&name.as_str());
        for name in required.into_iter().filter(|name| !known(name)) {
            self.notes.push(format!("The file requires the extension {name}, which is not read."));
        }
        take(&mut self.json, "extensionsRequired");
        Ok(())
    }

    fn tell_extensions(&mut self) {
        fn count(value: &Value, uses: &mut BTreeMap<String, usize>) {
            match value {
                Value::Object(members) => members.iter().for_each(|(key, value)| {
                    if let ("extensions", Value::Object(extensions)) = (key.as_str(), value) {
                        extensions.keys().for_each(|name| *uses.entry(name.clone()).or_default() += 1);
                    }
                    // A converter's own data is not the format's.
                    if key != "extras" {
                        count(value, uses);
                    }
                }),
                Value::Array(values) => values.iter().for_each(|value| count(value, uses)),
                _ => {}
            }
        }
        let mut uses = BTreeMap::new();
        count(&self.json, &mut uses);
        let is_ignored = |name: &str| !READ.contains(&name) && !NOTED_ELSEWHERE.contains(&name);
        for (name, count) in uses.into_iter().filter(|(name, _)| is_ignored(name)) {
            self.notes.push(format!("Ignored {count} uses of the extension {name}."));
        }
    }

    /// Gives the document a scene to show, and every scene its list of nodes.
    fn scenes(&mut self) {
        if list(&self.json, "scenes").is_empty() {
            let nodes = list(&self.json, "nodes");
            let mut is_root = vec![true; nodes.len()];
            for child in nodes.iter().flat_map(|node| list(node, "children")).filter_map(Value::as_u64) {
                if let Some(root) = is_root.get_mut(child as usize) {
                    *root = false;
                }
            }
            let roots: Vec<usize> = (0..nodes.len()).filter(|node| is_root[*node]).collect();
            self.note(roots.len(), "The file has no scene; its {} root nodes are shown.");
            self.json["scenes"] = json!([{ "nodes": roots }]);
            self.json["scene"] = json!(0);
        }
        for scene in list_mut(&mut self.json, "scenes") {
            if let Some(scene) = scene.as_object_mut() {
                scene.entry("nodes").or_insert_with(|| json!([]));
            }
        }
        let scenes = list(&self.json, "scenes");
        let has_nodes = |scene: &Value| !list(scene, "nodes").is_empty();
        let filled = scenes.iter().filter(|scene| has_nodes(scene)).count();
        let shown = index(&self.json, "scene")
            .unwrap_or_else(|| scenes.iter().position(has_nodes).unwrap_or_default());
        self.note(filled.saturating_sub(1), &format!("Scene {shown} is shown; {{}} further ones are not."));
        self.json["scene"] = json!(shown);
    }

    /// Takes out of animations what leads nowhere, which the parser would refuse. Numbers stay.
    fn animations(&mut self) {
        let [nodes, accessors] = ["nodes", "accessors"].map(|key| list(&self.json, key).len());
        let mut channels = 0;
        for animation in list_mut(&mut self.json, "animations") {
            let samplers = list(animation, "samplers");
            let are_sound = samplers.iter().all(|sampler| {
                is_in(sampler, "input", accessors)
                    && is_in(sampler, "output", accessors)
                    && matches!(
                        sampler["interpolation"].as_str(),
                        None | Some("LINEAR" | "STEP" | "CUBICSPLINE")
                    )
            });
            let leads = |channel: &&Value| {
                let target = &channel["target"];
                let path = target["path"].as_str();
                is_in(target, "node", nodes)
                    && matches!(path, Some("translation" | "rotation" | "scale" | "weights"))
                    && are_sound
                    && is_in(channel, "sampler", samplers.len())
            };
            let all = list(animation, "channels");
            // No more than is read: the parser would refuse the file for the rest, too.
            let channel = |one: &Value| {
                let target = json!({ "node": one["target"]["node"], "path": one["target"]["path"] });
                json!({ "sampler": one["sampler"], "target": target })
            };
            let kept: Vec<Value> = all.iter().filter(leads).map(channel).collect();
            channels += all.len() - kept.len();
            let sampler = |one: &Value| {
                let interpolation = one["interpolation"].as_str().unwrap_or("LINEAR");
                json!({ "input": one["input"], "output": one["output"], "interpolation": interpolation })
            };
            let samplers: Vec<Value> = samplers.iter().filter(|_| are_sound).map(sampler).collect();
            let name = animation["name"].as_str();
            *animation = json!({ "name": name, "channels": kept, "samplers": samplers });
        }
        self.note(
            channels,
            "Left out {} channels of animations that lead nowhere, or in no way that is known.",
        );
    }

    /// Takes out of skins and morph targets what leads nowhere. Numbers of skins stay.
    fn deformations(&mut self) {
        let [nodes, accessors, skins] =
            ["nodes", "accessors", "skins"].map(|key| list(&self.json, key).len());
        let (mut skinned, mut morphed) = (0, 0);
        for skin in list_mut(&mut self.json, "skins") {
            let joints = list(skin, "joints");
            let is_node = |joint: &Value| joint.as_u64().is_some_and(|joint| joint < nodes as u64);
            let bind = skin.get("inverseBindMatrices").cloned();
            let is_sound = joints.iter().all(is_node)
                && (bind.is_none() || is_in(skin, "inverseBindMatrices", accessors));
            *skin = if is_sound { json!({ "joints": joints }) } else { json!({ "joints": [] }) };
            if let Some(bind) = bind.filter(|_| is_sound) {
                skin["inverseBindMatrices"] = bind;
            }
        }
        for node in list_mut(&mut self.json, "nodes") {
            if node.get("skin").is_some() && !is_in(node, "skin", skins) {
                skinned += 1;
                take(node, "skin");
            }
        }
        for key in ["nodes", "meshes"] {
            for one in list_mut(&mut self.json, key) {
                let weights = one.get("weights").map(|_| list(one, "weights"));
                if weights.is_some_and(|all| all.is_empty() || !all.iter().all(Value::is_number)) {
                    take(one, "weights");
                }
            }
        }
        for primitive in list_mut(&mut self.json, "meshes").flat_map(|mesh| list_mut(mesh, "primitives")) {
            let is_known = |number: &Value| number.as_u64().is_some_and(|number| number < accessors as u64);
            let is_sound = |target: &Value| {
                target.as_object().is_some_and(|attributes| attributes.values().all(is_known))
            };
            let targets = primitive.get("targets");
            if targets.is_some_and(|all| !all.as_array().is_some_and(|all| all.iter().all(is_sound))) {
                morphed += 1;
                take(primitive, "targets");
            }
        }
        self.note(skinned, "Took {} meshes without skins that there are not.");
        self.note(morphed, "Took {} primitives without morph targets that there are not.");
    }

    /// Materials of diffuse, specular and gloss in the terms of metal and roughness.
    fn materials(&mut self) {
        const OTHER: &str = "KHR_materials_pbrSpecularGlossiness";
        let mut approximate = 0;
        for material in list_mut(&mut self.json, "materials") {
            let Some(other) = material.get_mut("extensions").and_then(|all| take(all, OTHER)) else {
                continue;
            };
            if material.get("pbrMetallicRoughness").is_some() {
                continue;
            }
            approximate += 1;
            let gloss = other.get("glossinessFactor").and_then(Value::as_f64).unwrap_or(1.0);
            let mut plain = json!({
                "metallicFactor": 0.0,
                "roughnessFactor": (1.0 - gloss).clamp(0.0, 1.0),
                "baseColorFactor": other.get("diffuseFactor").cloned().unwrap_or(json!([1.0, 1.0, 1.0, 1.0])),
            });
            if let Some(texture) = other.get("diffuseTexture") {
                plain["baseColorTexture"] = texture.clone();
            }
            material["pbrMetallicRoughness"] = plain;
        }
        self.note(
            approximate,
            "Took {} materials of specular and gloss (KHR_materials_pbrSpecularGlossiness) for dielectrics.",
        );
        // A spot without a cone has the one that the extension gives it.
        if let Some(lights) = self.json.pointer_mut("/extensions/KHR_lights_punctual") {
            for light in list_mut(lights, "lights").filter(|light| light["type"] == "spot") {
                if let Some(light) = light.as_object_mut() {
                    light.entry("spot").or_insert_with(|| json!({}));
                }
            }
        }
    }

    /// Takes textures without a picture out of materials, and notes options of samplers that are ignored.
    fn textures(&mut self) {
        // The parser expects a place for every picture, and in a buffer a kind, which its first bytes tell.
        for image in list_mut(&mut self.json, "images").filter_map(Value::as_object_mut) {
            let has = |key: &str| image.get(key).is_some_and(|value| !value.is_null());
            match (has("bufferView"), has("uri"), has("mimeType")) {
                (true, _, false) => drop(image.insert("mimeType".to_owned(), json!("image/png"))),
                (false, false, _) => drop(image.insert("uri".to_owned(), json!("data:,"))),
                _ => {}
            }
        }
        let mut others = BTreeMap::new();
        let textures = list(&self.json, "textures");
        let missing: Vec<bool> = textures.iter().map(|texture| texture.get("source").is_none()).collect();
        for texture in textures.iter().filter(|texture| texture.get("source").is_none()) {
            let extensions = texture.get("extensions").and_then(Value::as_object);
            let name = extensions.and_then(|all| all.keys().next()).map_or("no picture", String::as_str);
            *others.entry(name.to_owned()).or_insert(0) += 1;
        }
        for (name, count) in others {
            self.notes.push(format!("Left out {count} textures with {name} alone."));
        }
        let nearest =
            list(&self.json, "samplers").iter().filter(|sampler| sampler["magFilter"] == 9728).count();
        self.note(nearest, "{} samplers ask for the nearest pixel; all textures are smooth between pixels.");
        if !missing.contains(&true) {
            return;
        }
        fn forget(value: &mut Value, missing: &[bool]) {
            if let Value::Object(members) = value {
                members.retain(|key, member| {
                    let names = key.to_ascii_lowercase().ends_with("texture");
                    !(names
                        && index(member, "index").is_some_and(|number| missing.get(number) == Some(&true)))
                });
                members.values_mut().for_each(|member| forget(member, missing));
            }
        }
        list_mut(&mut self.json, "materials").for_each(|material| forget(material, &missing));
        // No material names them any more, but the parser wants a picture of each.
        let picture = list(&self.json, "images").len();
        let images = self.json.as_object_mut().map(|all| all.entry("images").or_insert_with(|| json!([])));
        if let Some(images) = images.and_then(Value::as_array_mut) {
            images.push(json!({ "uri": "data:," }));
        }
        for texture in list_mut(&mut self.json, "textures") {
            if let Some(texture) = texture.as_object_mut() {
                texture.entry("source").or_insert_with(|| json!(picture));
            }
        }
    }

    /// Takes out primitives without readable positions, and notes vertex attributes that are ignored.
    fn primitives(&mut self) {
        let accessors = list(&self.json, "accessors");
        let is_void =
            |accessor: &Value| accessor.get("bufferView").is_none() && accessor.get("sparse").is_none();
        let void: Vec<bool> = accessors.iter().map(is_void).collect();
        let is_void = |number: Option<usize>| number.is_some_and(|number| void.get(number) == Some(&true));
        let (mut coloured, mut many_joints, mut left_out, mut places) = (0, 0, 0, Vec::new());
        for mesh in list_mut(&mut self.json, "meshes") {
            let Some(primitives) = mesh.get_mut("primitives").and_then(Value::as_array_mut) else { continue };
            primitives.retain_mut(|primitive| {
                let no_indices = is_void(index(primitive, "indices"));
                let is_filled = |_: &String, accessor: &mut Value| {
                    !is_void(accessor.as_u64().map(|number| number as usize))
                };
                // Targets of zeros change nothing.
                for target in list_mut(primitive, "targets").filter_map(Value::as_object_mut) {
                    target.retain(is_filled);
                }
                let Some(attributes) = primitive.get_mut("attributes").and_then(Value::as_object_mut) else {
                    return true;
                };
                attributes.retain(is_filled);
                let place = attributes.get("POSITION").and_then(Value::as_u64);
                let is_drawn = place.is_some() && !no_indices;
                coloured += usize::from(is_drawn && attributes.contains_key("COLOR_0"));
                many_joints += usize::from(is_drawn && attributes.contains_key("JOINTS_1"));
                left_out += usize::from(!is_drawn);
                places.extend(place);
                is_drawn
            });
        }
        self.note(coloured, "Ignored the vertex colours (COLOR_0) of {} primitives.");
        self.note(many_joints, "Took the first four joints a vertex of {} primitives with more.");
        self.note(left_out, "Left out {} primitives without data for their positions or indices.");
        // The parser wants each to have its box, which is not used.
        for place in places {
            let accessor =
                self.json.pointer_mut(&format!("/accessors/{place}")).and_then(Value::as_object_mut);
            if let Some(accessor) = accessor {
                accessor.entry("min").or_insert_with(|| json!([0, 0, 0]));
                accessor.entry("max").or_insert_with(|| json!([0, 0, 0]));
            }
        }
        if void.contains(&true) {
            self.give_views();
        }
    }

    /// The parser wants a view of each accessor; nothing that is drawn names an accessor without one.
    fn give_views(&mut self) {
        let Some(all) = self.json.as_object_mut() else { return };
        let mut add = |key: &str, value: Value| {
            let list = all.entry(key).or_insert_with(|| json!([]));
            list.as_array_mut().map_or(0, |list| {
                list.push(value);
                list.len() - 1
            })
        };
        let buffer =
            add("buffers", json!({ "byteLength": 1, "uri": "data:application/octet-stream;base64,AA==" }));
        let view = add("bufferViews", json!({ "buffer": buffer, "byteLength": 1 }));
        for accessor in list_mut(&mut self.json, "accessors") {
            if let Some(accessor) =
                accessor.as_object_mut().filter(|accessor| !accessor.contains_key("sparse"))
            {
                accessor.entry("bufferView").or_insert_with(|| json!(view));
            }
        }
    }
}
