//! Embree: its C interface, the device, and its native scenes.

pub(crate) mod device;
pub(crate) mod ffi;
pub(crate) mod native;

pub use device::{Device, DeviceError};
pub use native::NativeScene;
