//! The edge to C: pointers become references, text and slices here and nowhere else.

use std::ffi::{CStr, c_char};
use std::mem::MaybeUninit;
use std::panic::{AssertUnwindSafe, catch_unwind};

use treewright_client::{Indicators, Measurements};

use crate::error::{Code, Failure};

/// Longest text that is taken from C, in bytes. A longer one is a pointer gone wrong.
const TEXT_BYTES_MAX: usize = 1 << 20;
/// Most numbers that one call may hand over.
const NUMBERS_MAX: usize = 4096;

/// Text from C, ending in a zero; may be `NULL`.
#[repr(transparent)]
#[derive(Clone, Copy, Debug)]
pub(crate) struct Text(*const c_char);

impl Text {
    /// Text of ours, for C, which reads it only while it lives.
    pub(crate) fn of(text: &CStr) -> Self {
        Self(text.as_ptr())
    }

    pub(crate) fn optional(&self) -> Result<Option<&str>, Failure> {
        if self.0.is_null() {
            return Ok(None);
        }
        // SAFETY: the header asks for NULL or text that ends in a zero and stays as it is during the call.
        let text = unsafe { CStr::from_ptr(self.0) };
        if text.count_bytes() > TEXT_BYTES_MAX {
            return Err(Failure::invalid(format!("a text is longer than {TEXT_BYTES_MAX} bytes")));
        }
        text.to_str().map(Some).map_err(|error| Failure::invalid(format!("a text is not UTF-8: {error}")))
    }

    /// The text; `what` names it in the error.
    pub(crate) fn read(&self, what: &str) -> Result<&str, Failure> {
        self.optional()?.ok_or_else(|| Failure::invalid(format!("{what} is NULL")))
    }

    /// The text, or a mistake to be kept.
    pub(crate) fn words(&self, what: &str) -> Result<&str, String> {
        self.read(what).map_err(|_| format!("{what} is NULL or not UTF-8"))
    }
}

/// An array of C; may be `NULL` where it has no elements.
#[repr(transparent)]
#[derive(Clone, Copy, Debug)]
pub(crate) struct Array<T>(*const T);

impl<T> Array<T> {
    pub(crate) fn none() -> Self {
        Self(std::ptr::null())
    }

    pub(crate) fn is_none(&self) -> bool {
        self.0.is_null()
    }

    pub(crate) fn read(&self, count: usize, what: &str) -> Result<&[T], Failure> {
        if count == 0 {
            return Ok(&[]);
        }
        if self.0.is_null() || !self.0.is_aligned() || count > isize::MAX as usize / size_of::<T>().max(1) {
            return Err(Failure::invalid(format!("{what} is no array of {count}")));
        }
        // SAFETY: the header asks for `count` elements that stay as they are during the call; alignment and
        // size were looked at.
        Ok(unsafe { std::slice::from_raw_parts(self.0, count) })
    }
}

/// Elements of C that lie `stride` bytes apart and need not be aligned, `N` numbers each.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Strided<T, const N: usize> {
    base: *const u8,
    stride: usize,
    count: usize,
    marker: std::marker::PhantomData<T>,
}

impl<T: Copy, const N: usize> Strided<T, N> {
    /// A stride of 0 means that they lie side by side.
    pub(crate) fn new(base: *const T, stride: usize, count: usize, what: &str) -> Result<Self, Failure> {
        let own = size_of::<T>() * N;
        let stride = if stride == 0 { own } else { stride };
        let fits = stride >= own && count.checked_mul(stride).is_some_and(|all| all <= isize::MAX as usize);
        if !fits || (base.is_null() && count > 0) {
            return Err(Failure::invalid(format!("{what} is no array of {count} with {stride} bytes each")));
        }
        Ok(Self { base: base.cast(), stride, count, marker: std::marker::PhantomData })
    }

    pub(crate) fn len(&self) -> usize {
        self.count
    }

    pub(crate) fn get(&self, index: usize) -> Option<[T; N]> {
        // SAFETY: the header asks for `count` elements of `stride` bytes, of which `index` is one; the bytes
        // need not be aligned, and every pattern of bits is a number (T is f32 or u32).
        (index < self.count)
            .then(|| unsafe { self.base.add(index * self.stride).cast::<[T; N]>().read_unaligned() })
    }
}

#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub(crate) struct Number {
    /// Spelt as in the study.
    pub(crate) name: Text,
    /// In the unit that the study expects.
    pub(crate) value: f64,
}

fn named(numbers: Array<Number>, count: usize) -> Result<Vec<(String, f64)>, Failure> {
    if count > NUMBERS_MAX {
        return Err(Failure::invalid(format!("{count} numbers at once; at most {NUMBERS_MAX} are taken")));
    }
    let numbers = numbers.read(count, "the list of numbers")?;
    numbers.iter().map(|each| Ok((each.name.read("the name of a number")?.to_owned(), each.value))).collect()
}

pub(crate) fn indicators(numbers: Array<Number>, count: usize) -> Result<Indicators, Failure> {
    Ok(named(numbers, count)?.into_iter().collect())
}

pub(crate) fn measurements(numbers: Array<Number>, count: usize) -> Result<Measurements, Failure> {
    Ok(named(numbers, count)?.into_iter().collect())
}

/// Where a failure is put; may be `NULL`.
#[repr(transparent)]
#[derive(Clone, Copy, Debug)]
pub(crate) struct ErrorOut(*mut *mut Failure);

impl ErrorOut {
    /// For functions that cannot fail but by a panic.
    pub(crate) fn nowhere() -> Self {
        Self(std::ptr::null_mut())
    }

    fn put(self, failure: Failure) {
        if !self.0.is_null() {
            // SAFETY: the header asks for NULL or room for a pointer. The old value is not read, so it need
            // not have been set before.
            unsafe { self.0.write(Box::into_raw(Box::new(failure))) };
        }
    }
}

/// Runs the body of an exported function: a failure goes into `error`, a panic becomes one.
pub(crate) fn guard<T>(error: ErrorOut, body: impl FnOnce() -> Result<T, Failure>) -> Option<T> {
    let result = catch_unwind(AssertUnwindSafe(body)).unwrap_or_else(|panic| {
        let words = panic.downcast_ref::<&str>().map(|words| (*words).to_owned());
        let words = words.or_else(|| panic.downcast_ref::<String>().cloned()).unwrap_or_default();
        Err(Failure::new(Code::Internal, format!("a defect of libtreewright: {words}")))
    });
    result.map_err(|failure| error.put(failure)).ok()
}

/// A handle that must not be `NULL`.
pub(crate) fn need<T>(handle: Option<T>, what: &str) -> Result<T, Failure> {
    handle.ok_or_else(|| Failure::invalid(format!("the {what} is NULL")))
}

/// Room for one result of C.
pub(crate) fn store<T>(room: Option<&mut MaybeUninit<T>>, value: T) -> Result<(), Failure> {
    put(Some(need(room, "room for the result")?), value);
    Ok(())
}

/// Stores a result where there is room.
pub(crate) fn put<T>(room: Option<&mut MaybeUninit<T>>, value: T) {
    if let Some(room) = room {
        room.write(value);
    }
}

/// Drops what C gives back.
pub(crate) fn free<T>(object: Option<Box<T>>) {
    guard(ErrorOut::nowhere(), || {
        drop(object);
        Ok(())
    });
}

/// The answer to C for the result of a body.
pub(crate) trait Answer {
    type Of;

    fn of(result: Option<Self::Of>) -> Self;
}

/// Whether it succeeded.
impl Answer for bool {
    type Of = ();

    fn of(result: Option<()>) -> Self {
        result.is_some()
    }
}

/// A handle, or `NULL`.
impl<T> Answer for Option<Box<T>> {
    type Of = T;

    fn of(result: Option<T>) -> Self {
        result.map(Box::new)
    }
}

/// What C puts together call by call. The first mistake is kept, and the call that uses it returns it.
pub(crate) trait Draft {
    fn mistake(&mut self) -> &mut Option<String>;
}

/// Changes a draft; a mistake is kept for later.
pub(crate) fn change<T: Draft>(draft: Option<&mut T>, change: impl FnOnce(&mut T) -> Result<(), String>) {
    if let Some(draft) = draft
        && let Err(mistake) = change(draft)
    {
        draft.mistake().get_or_insert(mistake);
    }
}
