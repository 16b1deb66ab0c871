//! The features of the integrator that a scene needs; all others are left out.
//!
//! They are decided once, when a scene is prepared, from the materials of its triangles and from its lights.
//! Each set of needs has a shading kernel of its own, compiled without the rest, so that leaving out costs no
//! test per ray. A kernel with more features gives an equal picture, bit for bit.

use serde::Serialize;

macro_rules! needs {
    ($($(#[$about:meta])* $name:ident $bit:literal,)*) => {
        /// The features that shading must have.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
        pub struct Needs {
            $($(#[$about])* pub $name: bool,)*
        }

        impl Needs {
            pub(super) const fn bits(self) -> usize {
                $((self.$name as usize) << $bit)|*
            }

            pub(super) const fn from_bits(bits: usize) -> Self {
                Self { $($name: bits >> $bit & 1 != 0,)* }
            }
        }
    };
}

needs! {
    /// Normals interpolated between the corners of a triangle.
    smooth 0,
    /// Surfaces that reflect: metals, mirrors, the gloss of dielectrics. Otherwise all are Lambert's.
    layers 1,
    /// Thin sheets that light passes straight through. They come with a reflecting layer.
    sheets 2,
    /// Emissive triangles.
    lamps 3,
    /// A sun.
    sun 4,
    /// More than one material.
    materials 5,
    /// Objects placed by instances; such kernels, and those of the four needs below, can do all above.
    instances 6,
    /// Materials with textures.
    textures 7,
    /// Transmitting solids, which bend light.
    solids 8,
    /// An environment map, which is sampled as a light.
    environment 9,
    /// Lights without size.
    punctual 10,
    /// Rough metals, for kernels that shade many hits at once; the others see the material.
    metals 11,
}

/// Something that a scene does not need.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Omission {
    /// The omitted feature.
    pub what: &'static str,
    /// Why the scene can do without.
    pub why: &'static str,
}

impl Needs {
    /// Everything: the kernel that renders any scene.
    pub const ALL: Self = Self::from_bits((1 << 12) - 1);
    /// The needs of which each set has a kernel where there are no others: the first six.
    const COMMON: usize = 63;
    /// The needs of which each set has a kernel that can do all of the common ones: the next five.
    const RARE: usize = 31;
    const COMMON_COUNT: usize = 6;
    pub(super) const SETS: usize = Self::COMMON + 1 + Self::RARE;

    const fn rare(self) -> usize {
        self.bits() >> Self::COMMON_COUNT & Self::RARE
    }

    pub(super) const fn kernel(self) -> usize {
        let closed = self.closed();
        match closed.rare() {
            0 => closed.bits() & Self::COMMON,
            rare => Self::COMMON + rare,
        }
    }

    /// The needs that a kernel's number covers; where its set is not closed, of the larger closed one.
    pub(super) const fn of_kernel(number: usize) -> Self {
        let bits = match number {
            0..=Self::COMMON => number,
            _ => Self::COMMON | (number - Self::COMMON) << Self::COMMON_COUNT,
        };
        Self::from_bits(bits).closed()
    }

    /// The closed set: sheets and rough metals reflect as well, and rare needs come with all the common ones.
    pub(super) const fn closed(self) -> Self {
        if self.rare() > 0 {
            Self::from_bits(self.bits() | Self::COMMON | Self::METALS)
        } else {
            Self { layers: self.layers || self.sheets || self.metals, ..self }
        }
    }

    const METALS: usize = 1 << (Self::COMMON_COUNT + 5);

    /// Whether a kernel for these needs can render a scene with those.
    pub fn covers(self, needed: Self) -> bool {
        needed.bits() & !self.bits() == 0
    }

    /// Whether some light is sampled, which takes shadow rays.
    pub const fn shadows(self) -> bool {
        self.lamps || self.sun || self.environment || self.punctual
    }

    /// Whether a last ray needs its hit, not only that there is one: a surface may shine or let it through.
    pub const fn last_hits(self) -> bool {
        self.shadows() || self.sheets
    }

    /// The features left out with these needs, with reasons.
    pub fn omissions(self) -> Vec<Omission> {
        let all = [
            (self.smooth, "interpolated normals", "every triangle is flat"),
            (
                self.layers,
                "reflection: metals, mirrors, gloss",
                "every material is matt with index of refraction 1",
            ),
            (self.sheets, "transmission", "no material lets light through"),
            (self.lamps, "emission and the sampling of lamps", "no triangle shines"),
            (self.sun, "the sun", "the sky has none"),
            (
                self.shadows(),
                "shadow rays",
                "no light is sampled: the sky is found by the surfaces' own sampling",
            ),
            (
                self.last_hits(),
                "nearest hits after the last bounce",
                "nothing there could shine, be lit or let light through: that something is met is enough",
            ),
            (self.materials, "the look-up of materials", "all triangles have one material"),
            (self.instances, "instances", "every triangle stands in the world itself"),
            (self.textures, "textures", "no material has one, beside masks that rays see through"),
            (self.solids, "refraction", "what lets light through is thin"),
            (self.environment, "the sampling of the sky", "there is no environment map"),
            (self.punctual, "lights without size", "there are none"),
            (self.metals, "reflection between the microfacets of rough metals", "no material is one"),
        ];
        let omitted = all.into_iter().filter(|(needed, ..)| !needed);
        omitted.map(|(_, what, why)| Omission { what, why }).collect()
    }

    /// These needs with one more each, for each that is not among them.
    #[cfg(test)]
    pub(super) fn one_more(self) -> impl Iterator<Item = Self> {
        let more = (0..12).map(move |bit| Self::from_bits(self.bits() | 1 << bit).closed());
        more.filter(move |more| *more != self)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_set_has_its_number() {
        for bits in 0..4096 {
            let needs = Needs::from_bits(bits);
            assert_eq!(needs.bits(), bits);
            assert!(Needs::ALL.covers(needs) && needs.covers(needs));
            assert_eq!(needs.covers(Needs::ALL), needs == Needs::ALL);
        }
    }

    #[test]
    fn a_kernel_can_do_what_is_needed_and_no_more_of_what_is_rare() {
        for bits in 0..4096 {
            let needs = Needs::from_bits(bits);
            let number = needs.kernel();
            assert!(number < Needs::SETS);
            let kernel = Needs::of_kernel(number);
            let common = Needs { metals: false, ..needs };
            assert!(kernel.covers(common), "{needs:?} {kernel:?}");
            assert_eq!(kernel.rare(), needs.rare());
            assert_eq!(Needs::of_kernel(kernel.kernel()), kernel);
        }
    }

    #[test]
    fn what_is_needed_is_not_listed() {
        assert!(Needs::ALL.omissions().is_empty());
        assert_eq!(Needs::from_bits(0).omissions().len(), 14);
    }
}
