//! Answers the newest question on a thread and skips older ones.

use super::PreviewError;
use crate::mailbox::Mailbox;
use std::thread::{Builder, JoinHandle};

/// A thread that answers the newest question and skips older ones. It ends when this is dropped.
pub(super) struct Worker<Q, A> {
    what: &'static str,
    /// The newest question. `None` ends the thread.
    pub(super) asked: Mailbox<Option<Q>>,
    answers: Mailbox<A>,
    thread: Option<JoinHandle<()>>,
}

impl<Q: Send + 'static, A: Send + 'static> Worker<Q, A> {
    /// Starts the thread of this name. `what` is its task as a verb phrase. `run` takes questions until there are none,
    /// and gives answers.
    pub(super) fn start(
        name: &str,
        what: &'static str,
        run: impl FnOnce(&Mailbox<Option<Q>>, &Mailbox<A>) + Send + 'static,
    ) -> Result<Self, PreviewError> {
        let (asked, answers) = (Mailbox::new(1), Mailbox::new(1));
        let (questions, given) = (asked.clone(), answers.clone());
        let thread = Builder::new().name(name.into()).spawn(move || run(&questions, &given));
        let thread = thread.map_err(|e| PreviewError::Thread { what, reason: format!("did not start: {e}") })?;
        Ok(Self { what, asked, answers, thread: Some(thread) })
    }

    /// Returns the newest answer that was not taken yet, or [`PreviewError::Thread`] if nothing will come any more.
    pub(super) fn newest(&self) -> Result<Option<A>, PreviewError> {
        // The thread is checked before the mailbox, so that its last answer is not missed.
        let ended = self.thread.as_ref().is_none_or(JoinHandle::is_finished);
        match self.answers.take() {
            None if ended => Err(PreviewError::Thread { what: self.what, reason: "ended unexpectedly".into() }),
            answer => Ok(answer),
        }
    }
}

impl<Q, A> Drop for Worker<Q, A> {
    fn drop(&mut self) {
        self.asked.push(None);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}
