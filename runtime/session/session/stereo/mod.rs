//! Shows the content of two eyes by one schedule, on two panels or on the halves of one monitor.

pub(crate) mod agreement;
pub(crate) mod both_eyes;
pub(crate) mod joined;
pub(crate) mod report;
#[cfg(test)]
mod tests;
pub(crate) mod two_eyed;
