//! Settings that replace those of the program: `quality=low;robust=off;device=tri_accel=bvh4.triangle4v`.

use std::ffi::{CStr, CString, c_int};
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, AtomicI32, Ordering::Relaxed};

/// `RTC_SCENE_FLAG_COMPACT` and `RTC_SCENE_FLAG_ROBUST`.
const COMPACT: c_int = 1 << 1;
const ROBUST: c_int = 1 << 2;
/// No setting.
const NOTHING: c_int = -1;

/// The settings; none at first.
pub(crate) struct Settings {
    quality: AtomicI32,
    set: AtomicI32,
    cleared: AtomicI32,
    has_device: AtomicBool,
    device: Mutex<Option<String>>,
}

pub(crate) static SETTINGS: Settings = Settings::new();

impl Settings {
    const fn new() -> Self {
        Self {
            quality: AtomicI32::new(NOTHING),
            set: AtomicI32::new(0),
            cleared: AtomicI32::new(0),
            has_device: AtomicBool::new(false),
            device: Mutex::new(None),
        }
    }

    /// Takes words in place of earlier ones. False, and nothing changes, where one is unknown.
    pub(crate) fn apply(&self, words: &str) -> bool {
        let (mut quality, mut set, mut cleared, mut device) = (NOTHING, 0, 0, None);
        for word in words.split(';').filter(|word| !word.is_empty()) {
            match word.split_once('=') {
                Some(("quality", "low")) => quality = 0,
                Some(("quality", "medium")) => quality = 1,
                Some(("quality", "high")) => quality = 2,
                Some(("robust", "on")) => set |= ROBUST,
                Some(("robust", "off")) => cleared |= ROBUST,
                Some(("compact", "on")) => set |= COMPACT,
                Some(("compact", "off")) => cleared |= COMPACT,
                Some(("device", text)) => device = Some(text.to_owned()),
                _ => return false,
            }
        }
        self.quality.store(quality, Relaxed);
        self.set.store(set, Relaxed);
        self.cleared.store(cleared, Relaxed);
        self.has_device.store(device.is_some(), Relaxed);
        *self.device.lock().unwrap_or_else(std::sync::PoisonError::into_inner) = device;
        true
    }

    /// The quality for scenes and geometries.
    pub(crate) fn quality(&self) -> Option<c_int> {
        let quality = self.quality.load(Relaxed);
        (quality != NOTHING).then_some(quality)
    }

    pub(crate) fn has_flags(&self) -> bool {
        self.set.load(Relaxed) | self.cleared.load(Relaxed) != 0
    }

    /// A scene's flags in place of its own.
    pub(crate) fn flags(&self, own: c_int) -> c_int {
        own & !self.cleared.load(Relaxed) | self.set.load(Relaxed)
    }

    /// A device's text in place of its own: the settings after the program's own.
    pub(crate) fn device(&self, own: Option<&CStr>) -> Option<CString> {
        if !self.has_device.load(Relaxed) {
            return None;
        }
        let added = self.device.lock().unwrap_or_else(std::sync::PoisonError::into_inner).clone()?;
        let own = own.map(CStr::to_string_lossy).filter(|own| !own.is_empty());
        CString::new(own.map_or_else(|| added.clone(), |own| format!("{own},{added}"))).ok()
    }
}
