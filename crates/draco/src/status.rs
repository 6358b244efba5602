//! Reads the shim's status.

use steadymesh_draco_sys as sys;

/// A status to hand to the shim, which fills it in.
pub(crate) fn unset() -> sys::Status {
    sys::Status {
        code: sys::INTERNAL,
        message: [0; 252],
    }
}

/// The message up to its terminating zero.
pub(crate) fn message(status: &sys::Status) -> String {
    let bytes: Vec<u8> = status
        .message
        .iter()
        .map(|&character| character.cast_unsigned())
        .take_while(|&byte| byte != 0)
        .collect();
    let text = String::from_utf8_lossy(&bytes);
    let text = text.trim_end_matches('.');
    if text.is_empty() {
        "libdraco gave no reason".to_owned()
    } else {
        text.to_owned()
    }
}
