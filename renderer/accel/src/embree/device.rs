//! The Embree device: one a process, checked once, its errors turned into values.
//!
//! Native scenes with other options need a device of their own: [`Device::suited`] keeps a bounded number of
//! them, which share threads and the count of memory.
//!
//! Embree keeps one error per thread, so it is read after every call that can fail. The text comes through
//! the error callback on the calling thread, and is kept per thread as well.

use std::ffi::{CStr, CString, c_char, c_uint, c_void};
use std::sync::atomic::{AtomicIsize, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::{cell::RefCell, panic::catch_unwind};

use super::ffi;
use crate::error::{BuildError, EmbreeFailure};
use crate::limits::{DEVICES_MAX, EMBREE_SERIES, THREADS_MAX};
use crate::{native_options::NativeOptions, traverse::Isa};

/// Why there is no device.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum DeviceError {
    /// `rtcNewDevice` failed with this error code.
    #[error(
        "Embree refused to start (error {0}): check that the processor has at least SSE2 and that memory is free"
    )]
    Refused(u32),
    /// The library is of another series than the one our structures are laid out for.
    #[error(
        "Embree is version {found}, but only {}.{}.x is verified: run `make setup` or point EMBREE_DIR at such an installation",
        EMBREE_SERIES.0,
        EMBREE_SERIES.1
    )]
    WrongVersion {
        /// The version found, for instance "4.2.0".
        found: String,
    },
    /// The process already has a device with another number of threads.
    #[error(
        "this process already opened Embree with {open} threads (0 means all) and cannot open it with {asked}"
    )]
    OtherThreads {
        /// Threads of the open device.
        open: usize,
        /// Threads asked for.
        asked: usize,
    },
    /// The program was compiled for another processor's instruction set alone (`TREEWRIGHT_KERNELS=native`).
    #[error(
        "this program was compiled for the processor it was built on, and this one lacks its instructions: build it here"
    )]
    OtherProcessor,
    /// More threads than the limit.
    #[error("{0} threads are more than the limit of {THREADS_MAX}")]
    TooManyThreads(usize),
}

/// The process's Embree device. Cloning shares it.
#[derive(Clone, Debug)]
pub struct Device {
    inner: Arc<Inner>,
}

#[derive(Debug)]
struct Inner {
    handle: ffi::RTCDevice,
    threads: usize,
    /// Shared with the devices below. Embree keeps its address, so this comes after the handle.
    memory: Arc<MemoryMonitor>,
    /// Devices with further options, the latest used last.
    suited: Mutex<Vec<(String, Device)>>,
}

thread_local! {
    /// Text of this thread's latest error.
    static MESSAGE: RefCell<String> = const { RefCell::new(String::new()) };
}

#[derive(Debug)]
struct MemoryMonitor {
    /// Bytes Embree holds for its structures.
    bytes: AtomicIsize,
    /// Bytes it may hold.
    budget: isize,
}

// SAFETY: Embree's device functions may be called from any thread; `MemoryMonitor` is synchronised.
unsafe impl Send for Inner {}
// SAFETY: as above.
unsafe impl Sync for Inner {}

/// The one device. It is never closed: TBB's threads live as long as the process anyway.
static OPEN: Mutex<Option<Device>> = Mutex::new(None);

impl Device {
    /// Opens Embree, or gives the open device again. `threads` build threads; 0 means one a core.
    pub fn open(threads: usize) -> Result<Self, DeviceError> {
        if threads > THREADS_MAX {
            return Err(DeviceError::TooManyThreads(threads));
        }
        if !Isa::detect().is_available() {
            return Err(DeviceError::OtherProcessor);
        }
        let mut open = OPEN.lock().unwrap_or_else(PoisonError::into_inner);
        match &*open {
            Some(device) if device.inner.threads == threads => Ok(device.clone()),
            Some(device) => Err(DeviceError::OtherThreads { open: device.inner.threads, asked: threads }),
            None => {
                let device = Self::new(threads, "", MemoryMonitor::new(isize::MAX))?;
                *open = Some(device.clone());
                Ok(device)
            }
        }
    }

    /// Another device of as many threads, on which Embree may hold `bytes` at any one time: builds that need
    /// more fail with [`BuildError::OutOfMemory`](crate::BuildError::OutOfMemory). Other memory does not
    /// count.
    pub fn with_memory_budget(&self, bytes: usize) -> Result<Self, DeviceError> {
        Self::new(self.inner.threads, "", MemoryMonitor::new(isize::try_from(bytes).unwrap_or(isize::MAX)))
    }

    /// The device for native scenes of these options, kept if it is among the latest [`DEVICES_MAX`].
    pub(crate) fn suited(&self, options: &NativeOptions) -> Result<Self, BuildError> {
        options.check()?;
        let further = options.device_options();
        if further.is_empty() {
            return Ok(self.clone());
        }
        let mut suited = self.inner.suited.lock().unwrap_or_else(PoisonError::into_inner);
        let device = match suited.iter().position(|(options, _)| *options == further) {
            Some(place) => suited.remove(place).1,
            None => {
                let memory = Arc::clone(&self.inner.memory);
                let refused = |error: DeviceError| {
                    BuildError::Embree(ffi::ERROR_UNKNOWN, format!("no device for {further}: {error}"))
                };
                Self::new(self.inner.threads, &further, memory).map_err(refused)?
            }
        };
        if suited.len() == DEVICES_MAX {
            suited.remove(0);
        }
        suited.push((further, device.clone()));
        Ok(device)
    }

    fn new(threads: usize, further: &str, memory: Arc<MemoryMonitor>) -> Result<Self, DeviceError> {
        // Configuration files in the home or working folder must not change measurements.
        let widest = Isa::widest().map_or_else(String::new, |isa| format!("max_isa={},", isa.name()));
        let options = CString::new(format!("ignore_config_files=1,threads={threads},{widest}{further}"))
            .expect("no zero byte in our own options");
        // SAFETY: a valid C string.
        let handle = unsafe { ffi::rtcNewDevice(options.as_ptr()) };
        if handle.is_null() {
            // SAFETY: a null device is allowed here and means the failed creation.
            let code = unsafe { ffi::rtc_get_device_error(handle) };
            return Err(DeviceError::Refused(code));
        }
        let inner = Inner { handle, threads, memory, suited: Mutex::default() };
        // SAFETY: the handle is valid.
        let version = unsafe { ffi::rtcGetDeviceProperty(handle, ffi::RTCDeviceProperty::VERSION) };
        let (major, minor, patch) = (version / 10_000, version / 100 % 100, version % 100);
        if (major, minor) != EMBREE_SERIES {
            return Err(DeviceError::WrongVersion { found: format!("{major}.{minor}.{patch}") });
        }
        let user = Arc::as_ptr(&inner.memory).cast_mut().cast::<c_void>();
        // SAFETY: the callbacks take `user` as `&MemoryMonitor`, which the device holds while it lives.
        unsafe {
            ffi::rtc_set_device_error_function(handle, Some(on_error), user);
            ffi::rtcSetDeviceMemoryMonitorFunction(handle, Some(on_memory_change), user);
        }
        Ok(Self { inner: Arc::new(inner) })
    }

    /// Version of the library as `(major, minor, patch)`.
    pub fn version(&self) -> (u32, u32, u32) {
        // SAFETY: the handle is valid.
        let version = unsafe { ffi::rtcGetDeviceProperty(self.handle(), ffi::RTCDeviceProperty::VERSION) };
        let version = u32::try_from(version).unwrap_or(0);
        (version / 10_000, version / 100 % 100, version % 100)
    }

    /// Number of build threads that was asked for; 0 for one a core.
    pub fn threads(&self) -> usize {
        self.inner.threads
    }

    /// Bytes Embree holds for its structures now, as its memory monitor counts them.
    pub fn bytes_held(&self) -> usize {
        usize::try_from(self.inner.memory.bytes.load(Ordering::Relaxed)).unwrap_or(0)
    }

    pub(crate) fn handle(&self) -> ffi::RTCDevice {
        self.inner.handle
    }

    /// The error of this thread's last Embree call, if it failed. Reading clears it.
    pub(crate) fn check(&self) -> Result<(), EmbreeFailure> {
        // SAFETY: the handle is valid.
        let code = unsafe { ffi::rtc_get_device_error(self.handle()) };
        if code == ffi::ERROR_NONE {
            return Ok(());
        }
        let message = MESSAGE.take();
        Err(EmbreeFailure { code, message })
    }
}

impl MemoryMonitor {
    fn new(budget: isize) -> Arc<Self> {
        Arc::new(Self { bytes: AtomicIsize::new(0), budget })
    }
}

impl Drop for Inner {
    fn drop(&mut self) {
        // SAFETY: the handle is valid and ours; structures hold a `Device`, so none outlives it.
        unsafe { ffi::rtcReleaseDevice(self.handle) };
    }
}

unsafe extern "C" fn on_error(_user: *mut c_void, _code: c_uint, text: *const c_char) {
    // Nothing may unwind into Embree; a message that cannot be kept is the lesser loss.
    let _ = catch_unwind(|| {
        if !text.is_null() {
            // SAFETY: not null, so a C string for the duration of the call.
            let text = unsafe { CStr::from_ptr(text) }.to_string_lossy().into_owned();
            MESSAGE.set(text);
        }
    });
}

/// `RTCMemoryMonitorFunction`: no, before memory is taken, makes that call fail with "out of memory".
unsafe extern "C" fn on_memory_change(user: *mut c_void, bytes: isize, after: bool) -> bool {
    // SAFETY: `user` is the device's `MemoryMonitor`.
    let memory = unsafe { &*user.cast::<MemoryMonitor>() };
    let held = memory.bytes.fetch_add(bytes, Ordering::Relaxed) + bytes;
    if bytes <= 0 || held <= memory.budget {
        return true;
    }
    if !after {
        // It will not be taken, so it will not be given back either.
        memory.bytes.fetch_sub(bytes, Ordering::Relaxed);
    }
    false
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn is_one_a_process() {
        let device = Device::open(0).expect("Embree is set up");
        let again = Device::open(0).expect("that device");
        assert!(Arc::ptr_eq(&device.inner, &again.inner));
        assert_eq!(Device::open(1).unwrap_err(), DeviceError::OtherThreads { open: 0, asked: 1 });
        assert!(matches!(Device::open(THREADS_MAX + 1), Err(DeviceError::TooManyThreads(_))));
    }

    #[test]
    fn is_of_the_verified_series() {
        let (major, minor, _) = Device::open(0).expect("Embree is set up").version();
        assert_eq!((major as isize, minor as isize), EMBREE_SERIES);
    }
}
