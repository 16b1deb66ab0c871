//! The textures of a scene in assembly, each picture once within the limit, and the masks among them.

use std::{collections::HashMap, collections::hash_map::Entry, sync::Arc};

use glam::Vec2;
use treewright_accel::{Card, GeometryError, Mask, Triangles};

use super::texture::{Encoding, Wrap};
use super::{Material, Mesh, Texture, images::Pixels, limits::TEXTURE_PIXELS_MAX, text::counted};

/// The identity of a texture: the source of its picture, the encoding of its values, its continuation.
type Key = (String, Encoding, [Wrap; 2]);

#[derive(Default)]
pub(super) struct Textures {
    pub(super) all: Vec<Arc<Texture>>,
    numbers: HashMap<Key, Option<u32>>,
    pixels: u64,
    /// Sentences about pictures that cannot be had.
    lost: Vec<String>,
}

impl Textures {
    /// See [`Assembler::texture`](super::assemble::Assembler::texture).
    pub(super) fn add(
        &mut self,
        key: &str,
        name: &str,
        encoding: Encoding,
        wrap: [Wrap; 2],
        make: impl FnOnce() -> Result<Pixels, String>,
    ) -> Option<u32> {
        let key = (key.to_owned(), encoding, wrap);
        if let Some(known) = self.numbers.get(&key) {
            return *known;
        }
        let number = match self.made(encoding, wrap, make) {
            Ok(texture) => {
                self.all.push(Arc::new(texture));
                Some(self.all.len() as u32 - 1)
            }
            Err(cause) => {
                self.lost.push(format!("The texture {name} is left out: {cause}."));
                None
            }
        };
        self.numbers.insert(key, number);
        number
    }

    fn made(
        &mut self,
        encoding: Encoding,
        wrap: [Wrap; 2],
        make: impl FnOnce() -> Result<Pixels, String>,
    ) -> Result<Texture, String> {
        if self.pixels >= TEXTURE_PIXELS_MAX {
            return Err(format!("the textures before it have {TEXTURE_PIXELS_MAX} pixels already"));
        }
        let Pixels { width, height, pixels } = make()?;
        self.pixels += pixels.len() as u64;
        if self.pixels > TEXTURE_PIXELS_MAX {
            return Err(format!("with it the textures would have more than {TEXTURE_PIXELS_MAX} pixels"));
        }
        Texture::new(width, height, pixels, encoding, wrap)
    }

    /// See [`Assembler::cuts_out`](super::assemble::Assembler::cuts_out).
    pub(super) fn cuts_out(&self, texture: u32) -> bool {
        let alpha = self.all.get(texture as usize).map(|texture| texture.alpha()).unwrap_or_default();
        let count =
            |range: std::ops::RangeInclusive<u8>| alpha.iter().filter(|alpha| range.contains(alpha)).count();
        let (clear, solid) = (count(0..=25), count(230..=255));
        clear > 0 && solid > 0 && (clear + solid) * 10 >= alpha.len() * 9
    }

    pub(super) fn finish(&mut self, notes: &mut Vec<String>) {
        const NOTES_MAX: usize = 5;
        let more = self.lost.len().saturating_sub(NOTES_MAX);
        notes.extend(self.lost.drain(..).take(NOTES_MAX));
        notes.extend(counted(more, "{} further textures are left out."));
    }
}

/// The triangles with the masks of those materials that are cut out by their texture's alpha.
pub(super) fn cut_out(
    triangles: Triangles,
    meshes: &[Mesh],
    materials: &[Material],
    textures: &Textures,
    uvs: &[Vec2],
) -> Result<Triangles, GeometryError> {
    let (mut masks, mut cards) = (Vec::new(), Vec::new());
    let mut mask_of = HashMap::new();
    for mesh in meshes {
        let material = &materials[mesh.material as usize];
        let Some(cutoff) = material.cutoff else { continue };
        let texture = material.base_color_texture.and_then(|number| textures.all.get(number as usize));
        // Without a texture it is solid or not there at all.
        if texture.is_none() && cutoff <= 1.0 {
            continue;
        }
        let mask = match mask_of.entry((material.base_color_texture, cutoff.to_bits())) {
            Entry::Occupied(known) => *known.get(),
            Entry::Vacant(place) => {
                let whole =
                    |texture: &Arc<Texture>| (texture.size().to_array(), texture.alpha(), texture.wrap());
                let ([width, height], alpha, wrap) =
                    texture.map_or(([1, 1], vec![255], Default::default()), whole);
                masks.push(Mask::new(width, height, alpha.into(), cutoff, wrap)?);
                *place.insert(masks.len() as u32 - 1)
            }
        };
        for triangle in mesh.first_triangle..mesh.first_triangle + mesh.triangle_count {
            let corners = triangles.indices()[triangle as usize].map(|vertex| uvs[vertex as usize]);
            cards.push((triangle, Card { mask, corners }));
        }
    }
    if cards.is_empty() { Ok(triangles) } else { triangles.masked(masks, cards) }
}
