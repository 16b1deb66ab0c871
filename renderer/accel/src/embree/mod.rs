//! Embree: its C interface, the device, and its native scenes.

pub(crate) mod device;
pub(crate) mod ffi;
mod filter;
pub(crate) mod instanced;
mod native;
mod packets;

pub use device::{Device, DeviceError};
pub use instanced::NativeInstances;
pub use native::NativeScene;
