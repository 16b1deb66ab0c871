//! Reads glTF 2.0, as text or binary. It reads nodes with their transforms, skins, morph targets, animations
//! of nodes, cameras and punctual lights. Meshes shared by several nodes are copied, or become instances
//! where [`INSTANCING_SAVES_MIN`] says so. Copies of a mesh below a node are read, too. Materials are those
//! of metal and roughness with their textures, and with the extensions for emissive strength, transmission,
//! volume, index of refraction and texture transforms. Lengths are metres and stay so.

use std::path::Path;

use glam::{Affine3A, DMat4, DVec3, Mat4, Vec3};
use gltf::khr_lights_punctual::{Kind, Light};
use gltf::{Document, Mesh, Node, Primitive, camera::Projection};

use super::animation::{Carried, Pose, Rig};
use super::assemble::{Assembler, Lighting};
use super::gltf_geometry::{self, Buffers};
use super::gltf_instances::{self, Copies};
use super::gltf_json::{self, Refusal};
use super::gltf_material::{self, Materials};
use super::limits::{DISTANCE_MAX, INSTANCING_SAVES_MIN, NODE_DEPTH_MAX, POSED_VERTICES_MAX};
use super::{
    Cone, Punctual, Scene, SceneError, Up, error::one_line, framing::CameraPose, gltf_animation, gltf_extras,
    part::Part,
};

pub(super) fn read(path: &Path, bytes: &[u8], up: Up) -> Result<Scene, SceneError> {
    let malformed =
        SceneError::malformed(path, "glTF", "export it again, complete and without mesh compression");
    let prepared = gltf_json::read(bytes).map_err(|refusal| match refusal {
        Refusal::Malformed(cause) => malformed(cause),
        Refusal::Unsupported(what) => SceneError::Unsupported {
            path: path.to_owned(),
            what,
            remedy: "export it again as glTF 2.0, without mesh compression".to_owned(),
        },
    })?;
    let text = prepared.json.to_string();
    let json = gltf::json::deserialize::from_str::<gltf::json::Root>(&text)
        .map_err(|error| malformed(one_line(&error.to_string())))?;
    // The validation below takes it for granted that the positions' accessor exists.
    let attributes = json
        .meshes
        .iter()
        .flat_map(|mesh| &mesh.primitives)
        .flat_map(|primitive| primitive.attributes.values());
    if let Some(missing) =
        attributes.map(gltf::json::Index::value).find(|index| *index >= json.accessors.len())
    {
        return Err(malformed(format!(
            "a mesh names accessor {missing}, but there are only {}",
            json.accessors.len()
        )));
    }
    let document = Document::from_json(json).map_err(|error| malformed(parse_message(&error)))?;
    let base = path.parent();
    let buffers = gltf_geometry::buffers(&document, base, prepared.blob).map_err(malformed)?;
    let mut assembler = Assembler::of_file(path, up);
    prepared.notes.into_iter().for_each(|note| assembler.note(note));
    let materials = gltf_material::read(&document, base, &buffers, &mut assembler);
    let copies = gltf_instances::read(&prepared.json, &document, &buffers, &mut assembler);
    let mut walk = Walk {
        buffers: &buffers,
        materials,
        assembler,
        views: Vec::new(),
        lights: Vec::new(),
        ignored_primitives: 0,
        orthographic: 0,
        instanced: Vec::new(),
        copies,
        rig: Rig::default(),
        moving: Default::default(),
        bending: Vec::new(),
        pose: Pose::default(),
        posed: 0,
        unposed: Vec::new(),
        malformed: &malformed,
    };
    walk.scene(&document)?;
    walk.objects(&document)?;
    walk.finish(&document)
}

/// The parser's error in one line, with the places of a failed validation.
fn parse_message(error: &gltf::Error) -> String {
    match error {
        gltf::Error::Validation(faults) => {
            let shown: Vec<String> =
                faults.iter().take(3).map(|(place, what)| format!("{place}: {what}")).collect();
            let more = faults.len() - shown.len();
            let more = if more > 0 { format!("; and {more} more") } else { String::new() };
            format!("{}{more}", shown.join("; "))
        }
        other => one_line(&other.to_string()),
    }
}

/// The places of an object in the world, and what carries those that move.
type Places = Vec<(Affine3A, Option<Carried>)>;

/// An empty list for each mesh that becomes an object: those of several nodes, if that saves enough
/// triangles, and that are not skinned, morphed or flattened by animations that there is room for.
pub(super) fn shared_meshes(document: &Document, copies: &Copies, flattened: &[bool]) -> Vec<Option<Places>> {
    let sum = |mesh: &Mesh, of: fn(&Primitive) -> u64| {
        mesh.primitives().fold(0_u64, |sum, one| sum.saturating_add(of(&one)))
    };
    let mut uses = vec![0u64; document.meshes().len()];
    let mut is_own = vec![false; uses.len()];
    for node in document.nodes() {
        if let Some(mesh) = node.mesh() {
            uses[mesh.index()] += copies.get(&node.index()).map_or(1, |copies| copies.len() as u64);
            is_own[mesh.index()] |= flattened[node.index()] || node.skin().is_some();
        }
    }
    let mut posed = 0_u64;
    for mesh in document.meshes() {
        let number = mesh.index();
        if is_own[number] || mesh.primitives().any(|one| one.morph_targets().next().is_some()) {
            let vertices = sum(&mesh, gltf_geometry::vertex_count);
            posed = posed.saturating_add(vertices.saturating_mul(uses[number]));
            if posed <= POSED_VERTICES_MAX as u64 {
                uses[number] = 0;
            }
        }
    }
    let saved = document.meshes().fold(0_u64, |saved, mesh| {
        let triangles = sum(&mesh, gltf_geometry::triangle_count);
        saved.saturating_add(triangles.saturating_mul(uses[mesh.index()].saturating_sub(1)))
    });
    uses.into_iter().map(|uses| (uses > 1 && saved > INSTANCING_SAVES_MIN).then(Vec::new)).collect()
}

/// Distance from the origin below which nodes of any size keep their digits.
const FAR_NODES: f64 = 1e4;

/// Where to put the origin so that meshes close together and far away keep their digits; else zero.
fn far_origin(nodes: &[(Node, DMat4)]) -> DVec3 {
    let with_mesh = nodes.iter().filter(|(node, _)| node.mesh().is_some());
    let mut places = with_mesh.map(|(_, to_world)| to_world.w_axis.truncate());
    let Some(first) = places.next().filter(|first| first.is_finite() && first.length() > FAR_NODES) else {
        return DVec3::ZERO;
    };
    let extent = places.map(|place| place.distance(first)).fold(0.0, f64::max);
    if first.length() > DISTANCE_MAX * extent { first } else { DVec3::ZERO }
}

struct Walk<'a> {
    buffers: &'a Buffers,
    materials: Materials,
    assembler: Assembler,
    views: Vec<CameraPose>,
    lights: Vec<Punctual>,
    ignored_primitives: usize,
    /// Cameras that are left out.
    orthographic: usize,
    copies: Copies,
    /// By mesh: where it stands, for one that becomes an object with instances.
    instanced: Vec<Option<Places>>,
    rig: Rig,
    /// By node: whether an animation moves it; whether one morphs its mesh; and whether one may flatten it.
    moving: [Vec<bool>; 3],
    /// By skin: whether an animation moves a joint.
    bending: Vec<bool>,
    /// Where all is at rest.
    pose: Pose,
    /// Vertices of pieces of the rig, and their changes; for a moment also of one that does not move.
    posed: usize,
    /// Why skins and morph targets of meshes are left out.
    unposed: Vec<String>,
    malformed: &'a dyn Fn(String) -> SceneError,
}

/// A mesh's place in the world: the node, and where the mesh stands in it and in the world.
struct Stand<'a> {
    node: &'a Node<'a>,
    to_node: Mat4,
    to_world: Mat4,
}

impl Walk<'_> {
    /// Visits every node below the default scene, without recursion: the depth is the file's choice.
    fn scene(&mut self, document: &Document) -> Result<(), SceneError> {
        let scene = document.default_scene().or_else(|| document.scenes().next());
        let roots: Vec<Node> = match scene {
            Some(scene) => scene.nodes().collect(),
            None => document.nodes().collect(),
        };
        let mut seen = vec![false; document.nodes().len()];
        let mut stack: Vec<(Node, Option<usize>, DMat4, usize)> =
            roots.into_iter().rev().map(|node| (node, None, DMat4::IDENTITY, 0)).collect();
        let (mut found, mut order) = (Vec::new(), Vec::new());
        while let Some((node, above, parent, depth)) = stack.pop() {
            if std::mem::replace(&mut seen[node.index()], true) {
                return Err((self.malformed)(format!(
                    "node {} has two parents or is its own ancestor",
                    node.index()
                )));
            }
            if depth > NODE_DEPTH_MAX {
                return Err((self.malformed)(format!("its nodes are nested deeper than {NODE_DEPTH_MAX}")));
            }
            let to_world = parent * Mat4::from_cols_array_2d(&node.transform().matrix()).as_dmat4();
            // The copy in `children` keeps the order of the file, which makes mesh order stable.
            let children: Vec<Node> = node.children().collect();
            let here = Some(node.index());
            stack.extend(children.into_iter().rev().map(|child| (child, here, to_world, depth + 1)));
            order.push((node.index(), above));
            found.push((node, to_world));
        }
        let origin = far_origin(&found);
        self.assembler.moved_to(origin);
        let to_scene = DMat4::from_translation(-origin);
        self.rig = gltf_animation::read(document, order, self.buffers, &mut self.assembler);
        self.moving = self.rig.moving();
        self.pose = self.rig.pose(None, to_scene);
        let is_moved = |skin: &Vec<(usize, Mat4)>| skin.iter().any(|(joint, _)| self.moving[0][*joint]);
        self.bending = self.rig.skins.iter().map(is_moved).collect();
        self.instanced = shared_meshes(document, &self.copies, &self.moving[2]);
        let is_shared = |mesh: Mesh| self.instanced[mesh.index()].is_some();
        let poses = |node: &Node| self.moving[2][node.index()] || node.skin().is_some();
        let still =
            found.iter().filter(|(node, _)| poses(node) && node.mesh().is_some_and(is_shared)).count();
        if still > 0 {
            self.assembler.note(format!(
                "{still} nodes stand still, without skins: their meshes have over {POSED_VERTICES_MAX} vertices."
            ));
        }
        for (node, to_world) in found {
            self.node(&node, &(to_scene * to_world).as_mat4())?;
        }
        Ok(())
    }

    fn node(&mut self, node: &Node, to_world: &Mat4) -> Result<(), SceneError> {
        if let Some(camera) = node.camera() {
            match camera.projection() {
                Projection::Perspective(perspective) => self.views.push(CameraPose {
                    position: to_world.w_axis.truncate(),
                    forward: -to_world.z_axis.truncate(),
                    up: to_world.y_axis.truncate(),
                    vertical_fov_deg: perspective.yfov().to_degrees(),
                    framed_aspect: perspective.aspect_ratio(),
                    distance: None,
                }),
                Projection::Orthographic(_) => self.orthographic += 1,
            }
        }
        if let Some(light) = node.light() {
            self.light(&light, to_world);
        }
        let Some(mesh) = node.mesh() else { return Ok(()) };
        let here = [Mat4::IDENTITY];
        let copies = std::mem::take(&mut self.copies);
        for copy in copies.get(&node.index()).map_or(&here[..], Vec::as_slice) {
            self.placed(&mesh, &Stand { node, to_node: *copy, to_world: *to_world * *copy })?;
        }
        self.copies = copies;
        Ok(())
    }

    /// Light shines along the node's negative z axis.
    fn light(&mut self, light: &Light, to_world: &Mat4) {
        let strength = Vec3::from_array(light.color()) * light.intensity();
        let (position, backward) = (to_world.w_axis.truncate(), to_world.z_axis.truncate());
        let cone = match light.kind() {
            Kind::Directional => return self.lights.push(Punctual::towards(backward, strength)),
            Kind::Point => None,
            Kind::Spot { inner_cone_angle, outer_cone_angle } => {
                Some(Cone::new(-backward, inner_cone_angle, outer_cone_angle))
            }
        };
        let range = light.range().unwrap_or(f32::INFINITY);
        self.lights.push(Punctual::Point { position, intensity: strength, cone, range });
    }

    /// Adds a mesh where it stands, or sets the place aside for its object.
    fn placed(&mut self, mesh: &Mesh, stand: &Stand) -> Result<(), SceneError> {
        if let Some(places) = &mut self.instanced[mesh.index()]
            && stand.to_world.determinant() != 0.0
        {
            let (node, to_node) = (stand.node.index(), stand.to_node);
            let moves = self.moving[0][node] && !self.moving[2][node] && stand.node.skin().is_none();
            let carried = moves.then_some(Carried { instance: 0, node, to_node });
            places.push((Affine3A::from_mat4(stand.to_world), carried));
            return Ok(());
        }
        self.mesh(mesh, mesh.name().or(stand.node.name()).map(str::to_owned), Some(stand))
    }

    /// Brings a primitive's triangles to the world, posed at rest, and remembers what animations move.
    fn bring(&mut self, primitive: &Primitive, part: &mut Part, stand: &Stand) {
        let node = stand.node.index();
        let has_targets = primitive.morph_targets().next().is_some();
        let skin =
            stand.node.skin().map(|skin| skin.index()).filter(|skin| !self.rig.skins[*skin].is_empty());
        let is_carried = skin.map_or(self.moving[0][node], |skin| self.bending[skin]);
        let moves = is_carried || (has_targets && self.moving[1][node]);
        if !moves && !has_targets && skin.is_none() {
            return part.transform(&stand.to_world);
        }
        let (place, kept) = ((stand.node, stand.to_node), self.posed);
        let piece = gltf_animation::piece(primitive, part, place, &self.rig, self.buffers, &mut self.posed);
        let piece = match piece {
            Ok(piece) => piece,
            Err(fault) => {
                self.posed = kept;
                self.unposed.push(fault);
                return part.transform(&stand.to_world);
            }
        };
        if piece.skin.is_some() {
            [part.positions, part.normals] = piece.posed(&self.pose);
            // Front sides stay front sides, also where no normals tell them.
            let mirrored = |triangle: &&mut [u32; 3]| piece.is_mirrored(triangle, &self.pose);
            part.indices.iter_mut().filter(mirrored).for_each(|triangle| triangle.swap(1, 2));
        } else {
            [part.positions, part.normals] = piece.morphed(&piece.weights);
            part.transform(&stand.to_world);
        }
        if moves {
            self.assembler.moves_from(self.rig.vertex_count);
            self.rig.vertex_count += part.positions.len() as u32;
            self.rig.pieces.push(piece);
        } else {
            self.posed = kept;
        }
    }

    /// Adds a mesh in the world, or as it is to the object that is being made.
    fn mesh(&mut self, mesh: &Mesh, name: Option<String>, stand: Option<&Stand>) -> Result<(), SceneError> {
        let name = name.unwrap_or_else(|| format!("mesh {}", mesh.index()));
        for primitive in mesh.primitives() {
            let place = |cause: String| (self.malformed)(format!("mesh \"{name}\": {cause}"));
            let coordinates = self.materials.coordinates(&primitive.material());
            match gltf_geometry::read(&primitive, self.buffers, &coordinates).map_err(place)? {
                Some(mut part) => {
                    if let Some(stand) = stand {
                        self.bring(&primitive, &mut part, stand);
                    }
                    let material = self.materials.of(&primitive.material(), &mut self.assembler);
                    self.assembler.mesh(name.clone(), material, &part)?;
                }
                None => self.ignored_primitives += 1,
            }
        }
        Ok(())
    }

    /// Makes objects of the meshes that were set aside, and places them.
    fn objects(&mut self, document: &Document) -> Result<(), SceneError> {
        let set_aside = std::mem::take(&mut self.instanced);
        for (mesh, places) in document.meshes().zip(set_aside) {
            let Some(places) = places.filter(|places| !places.is_empty()) else { continue };
            self.assembler.begin_object();
            self.mesh(&mesh, mesh.name().map(str::to_owned), None)?;
            let object = self.assembler.end_object();
            for (to_world, carried) in places {
                if self.assembler.place(object, to_world) {
                    let instance = self.rig.instance_count;
                    self.rig.carried.extend(carried.map(|carried| Carried { instance, ..carried }));
                    self.rig.instance_count += 1;
                }
            }
        }
        Ok(())
    }

    /// Gives the scene its animations, and says which there are.
    fn animate(&mut self) {
        self.rig.keep_what_moves();
        let clips = self.rig.clips.iter().enumerate().filter(|(_, clip)| !clip.tracks.is_empty());
        let names = clips.map(|(number, clip)| match &clip.name {
            Some(name) => format!("{number} {name}"),
            None => format!("{number}"),
        });
        let names: Vec<String> = names.collect();
        let (count, idle) = (names.len(), self.rig.clips.len() - names.len());
        self.assembler.note_count(idle, "Ignored {} animations, which move no mesh.");
        if count == 0 {
            return;
        }
        let names = one_line(&names.join(", "));
        self.assembler.note(format!(
            "The file has {count} animations ({names}), for the motion of its file; without it the scene stands as its nodes say."
        ));
        self.assembler.animate(std::mem::take(&mut self.rig));
    }

    fn finish(mut self, document: &Document) -> Result<Scene, SceneError> {
        let ignored = "Ignored {} primitives of points or lines or without a vertex.";
        self.assembler.note_count(self.ignored_primitives, ignored);
        self.assembler.note_count(self.orthographic, "Ignored {} orthographic cameras.");
        if let Some(first) = self.unposed.first() {
            let count = self.unposed.len();
            self.assembler.note(format!(
                "Took {count} primitives without their skins, morph targets and animations: {first}."
            ));
        }
        self.animate();
        if document.meshes().len() == 0 {
            self.assembler.note("no meshes");
        }
        let extras = document
            .default_scene()
            .or_else(|| document.scenes().next())
            .and_then(|scene| scene.extras().as_ref().map(|raw| gltf_extras::parse(raw.get())));
        let mut sky = None;
        if let Some(extras) = extras {
            self.views.extend(extras.views);
            // A sun of glTF's own stands for that of the extras.
            let has_sun = self.lights.iter().any(|light| matches!(light, Punctual::Directional { .. }));
            sky = extras.sky.filter(|_| !has_sun);
            extras.notes.into_iter().for_each(|note| self.assembler.note(note));
        }
        self.assembler.lights(self.lights);
        let lighting = sky.map_or(Lighting::Automatic, Lighting::Given);
        self.assembler.finish(lighting, self.views)
    }
}
