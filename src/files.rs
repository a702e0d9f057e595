//! Whole files: reads only regular files; writes atomically, so that a file appears complete or not at all.

use crate::error::{Error, Result};
use std::ffi::OsString;
use std::fs::{self, File};
use std::io::{self, BufWriter, ErrorKind, Read, Write};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};

/// Largest file that is read \[bytes\].
const MOST: u64 = 4 << 30;

/// Opens a regular file. A pipe or a device is refused: it may never end, or never start. The error describes the
/// problem without the file's name.
pub(crate) fn open(path: &Path) -> std::result::Result<File, String> {
    let describe = |error: io::Error| match error.kind() {
        ErrorKind::NotFound => "does not exist; check the path".to_owned(),
        ErrorKind::PermissionDenied => "cannot be read; check its permissions".to_owned(),
        _ => format!("cannot be read: {error}"),
    };
    let metadata = fs::metadata(path).map_err(describe)?;
    if metadata.is_dir() {
        return Err("is a folder; give a file".into());
    }
    if !metadata.is_file() {
        return Err("is not a regular file; copy its content to a regular file".into());
    }
    File::open(path).map_err(describe)
}

/// Reads a whole regular file.
pub fn read(path: &Path) -> std::result::Result<Vec<u8>, String> {
    let file = open(path)?;
    let broken = |error: io::Error| format!("cannot be read: {error}");
    let length = file.metadata().map_err(broken)?.len();
    if length > MOST {
        return Err("is larger than 4 GiB; split it".into());
    }
    let mut bytes = Vec::with_capacity(length as usize);
    file.take(MOST).read_to_end(&mut bytes).map_err(broken)?;
    Ok(bytes)
}

/// The paths of what lies in a folder, sorted. The error describes the problem without the folder's name.
pub fn list(folder: &Path) -> std::result::Result<Vec<PathBuf>, String> {
    let entries = fs::read_dir(folder).map_err(|error| match error.kind() {
        ErrorKind::NotFound => "does not exist; check the path".to_owned(),
        ErrorKind::PermissionDenied => "cannot be listed; check the folder's permissions".to_owned(),
        ErrorKind::NotADirectory => "is not a folder; give a folder".to_owned(),
        _ => format!("cannot be listed: {error}; choose another folder"),
    })?;
    let mut paths: Vec<PathBuf> = entries.filter_map(|entry| Some(entry.ok()?.path())).collect();
    paths.sort();
    Ok(paths)
}

/// Writes a file under a temporary name in the same folder and renames it when it is complete on disk. A reader sees
/// the old file or the whole new one.
///
/// # Errors
/// Fails if the file cannot be written; the old file stays.
pub fn replace_file(path: &Path, write: impl FnOnce(&mut BufWriter<File>) -> io::Result<()>) -> Result<()> {
    replace(path, write).map_err(|error| output(path, &error))
}

/// [`replace_file`] with the given bytes.
///
/// # Errors
/// Fails if the file cannot be written; the old file stays.
pub fn write(path: &Path, bytes: &[u8]) -> Result<()> {
    replace_file(path, |file| file.write_all(bytes))
}

/// Checks that `replace_file` can write here, before starting long work.
///
/// # Errors
/// Fails if the file cannot be written.
pub fn check_writable(path: &Path) -> Result<()> {
    Unfinished::beside(path).map(drop).map_err(|error| output(path, &error))
}

/// [`replace_file`] with the system's own error.
pub(crate) fn replace(path: &Path, write: impl FnOnce(&mut BufWriter<File>) -> io::Result<()>) -> io::Result<()> {
    let (unfinished, file) = Unfinished::beside(path)?;
    let mut file = BufWriter::new(file);
    write(&mut file)?;
    // Not left to the buffer's drop, which would swallow a disk-full error.
    file.into_inner().map_err(io::IntoInnerError::into_error)?.sync_all()?;
    unfinished.finish(path)
}

/// The error for a file that cannot be written, with a remedy.
fn output(path: &Path, error: &io::Error) -> Error {
    let remedy = match error.kind() {
        ErrorKind::NotFound => "the folder does not exist; create it first",
        ErrorKind::PermissionDenied | ErrorKind::ReadOnlyFilesystem => "choose a writable folder",
        ErrorKind::StorageFull | ErrorKind::QuotaExceeded => "free some space or choose another disk",
        ErrorKind::FileTooLarge => "raise the file size limit or choose another disk",
        ErrorKind::IsADirectory => "give the name of a file",
        _ => "choose another path",
    };
    Error::Output { file: path.to_owned(), reason: format!("{error}; {remedy}") }
}

/// Temporary files that are being written.
static UNFINISHED: Mutex<Vec<PathBuf>> = Mutex::new(Vec::new());

fn unfinished() -> MutexGuard<'static, Vec<PathBuf>> {
    UNFINISHED.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Removes all partial files, for a process that a signal is about to end. Afterwards, threads that start or finish a
/// file block.
pub fn abandon() {
    let files = unfinished();
    for file in files.iter() {
        // Best effort: the process is about to end.
        let _ = fs::remove_file(file);
    }
    std::mem::forget(files);
}

/// A file under a temporary name; removed on drop unless finished.
struct Unfinished(PathBuf);

impl Unfinished {
    /// Creates a temporary file that no other process writes to.
    fn beside(path: &Path) -> io::Result<(Self, File)> {
        let name = path.file_name().ok_or_else(|| io::Error::other("the path names no file"))?;
        let text = path.as_os_str().as_encoded_bytes();
        if text.last().is_some_and(|last| std::path::is_separator(char::from(*last))) {
            return Err(ErrorKind::IsADirectory.into());
        }
        match fs::metadata(path) {
            Ok(there) if there.is_dir() => return Err(ErrorKind::IsADirectory.into()),
            Ok(there) if !there.is_file() => return Err(io::Error::other("it is not a regular file")),
            _ => {}
        }
        let mut files = unfinished();
        for attempt in files.len().. {
            let mut hidden = OsString::from(format!(".{}-{attempt}.", std::process::id()));
            hidden.push(name);
            let temporary = path.with_file_name(hidden);
            match File::create_new(&temporary) {
                // Left over from a killed process with the same process ID.
                Err(error) if error.kind() == ErrorKind::AlreadyExists => {}
                Err(error) => return Err(error),
                Ok(file) => {
                    files.push(temporary.clone());
                    return Ok((Self(temporary), file));
                }
            }
        }
        unreachable!("some number is free")
    }

    /// Renames the temporary file to its final name.
    fn finish(self, path: &Path) -> io::Result<()> {
        let mut files = unfinished();
        fs::rename(&self.0, path)?;
        files.retain(|file| *file != self.0);
        std::mem::forget(self);
        Ok(())
    }
}

impl Drop for Unfinished {
    fn drop(&mut self) {
        let mut files = unfinished();
        // Best effort: the earlier error is the one to report.
        let _ = fs::remove_file(&self.0);
        files.retain(|file| *file != self.0);
    }
}
