// eyebox computes phase holograms for near-eye displays. This is its interface for C and C++. cbindgen generates this
// file from tools/c, so make changes there.
//
// Pointers. A pointer must not be null unless its description allows it. Texts are UTF-8 and end with a zero byte.
// Arrays come with the number of their values. Before eyebox reads or writes an array, it compares this number with the
// number that the function requires.
//
// Handles. A function that makes a handle writes it into a variable of the caller, or writes null if it fails. The
// caller owns the handle and frees it once with the `free` function of its type, which also accepts null. The handles
// from which a handle was made may be freed before it. It is undefined to free a handle twice, or while it is in use.
//
// Errors. A function returns EYEBOX_STATUS_OK or the kind of its error. Every function may also return
// EYEBOX_STATUS_POINTER for a null or misaligned pointer, EYEBOX_STATUS_ARGUMENT for a value outside its range, and
// EYEBOX_STATUS_INTERNAL. Functions that compute may return EYEBOX_STATUS_ENGINE. The cause is a sentence per thread,
// which `eyebox_last_error` returns. This text stays valid until the same thread calls `eyebox_last_error` after
// another failure. Other calls and other threads do not change it.
//
// Threads. Any thread may call any function. Displays, scenes, holograms and encoders never change, so any number of
// threads may use one at once. Calls with one engine, one refiner or one session wait for each other. The exceptions
// are eyebox_session_look and eyebox_session_look_moving, which never wait. An engine costs little compared with its
// computations, so open one per thread. eyebox computes on its own threads, whose number is RAYON_NUM_THREADS or the
// number of cores. A session has further threads until it is freed.
//
// Fork. Threads do not survive a fork. After an engine was opened, a scene was made or a session was started, a child
// process that is then forked cannot use eyebox. Its calls fail with EYEBOX_STATUS_ENGINE, and `free` has no effect.
//
// Units. Lengths are in meters, phases in radians, and light is linear. The axis order is (row = y, column = x), with
// +x to the right and +y down.


#ifndef EYEBOX_H
#define EYEBOX_H

#include <stddef.h>
#include <stdint.h>

// The version of the interface that this header describes. It rises with each change that requires programs to be
// compiled again.
#define EYEBOX_INTERFACE 2

// The bit of red in a set of colors.
#define EYEBOX_RED 1

// The bit of green in a set of colors.
#define EYEBOX_GREEN 2

// The bit of blue in a set of colors.
#define EYEBOX_BLUE 4

// The result of a function. If it is not EYEBOX_STATUS_OK, `eyebox_last_error` returns the cause.
typedef enum {
  // The call succeeded without an error.
  EYEBOX_STATUS_OK = 0,
  // A pointer is null although the function requires it, or is misaligned.
  EYEBOX_STATUS_POINTER = 1,
  // A number, a text or the length of an array is outside the range of the function.
  EYEBOX_STATUS_ARGUMENT = 2,
  // The error is about the display, or about a pupil in front of it.
  EYEBOX_STATUS_DISPLAY = 3,
  // The error is about the scene, its file or its views.
  EYEBOX_STATUS_SCENE = 4,
  // The error is about the settings, or about the solve or refinement that they describe.
  EYEBOX_STATUS_SOLVE = 5,
  // The error is about the hologram, its file, or the scene or display that it names.
  EYEBOX_STATUS_HOLOGRAM = 6,
  // The error is about the encoding, or about the phases to encode.
  EYEBOX_STATUS_ENCODE = 7,
  // The error is about the engine or its device, or the process was forked.
  EYEBOX_STATUS_ENGINE = 8,
  // The error is a fault of eyebox itself. Please report it. The program may free the handles of the failed call,
  // but must not use them for anything else.
  EYEBOX_STATUS_INTERNAL = 9,
  // The error is about the session, or about the display on which it shows.
  EYEBOX_STATUS_SESSION = 10,
} EyeboxStatus;

// A display, with its SLM, its optics and its encoding of phases. It never changes.
typedef struct EyeboxDisplay EyeboxDisplay;

// An encoder. It turns phases of one shape into the video frames of one display. It never changes.
typedef struct EyeboxEncoder EyeboxEncoder;

// An engine, which computes on the CPU or on a Vulkan device. Calls with one engine wait for each other.
typedef struct EyeboxEngine EyeboxEngine;

// A hologram, with its phases, its optics and the record of its solve. It never changes.
typedef struct EyeboxHologram EyeboxHologram;

// A hologram under refinement, with its own engines. Calls with one refiner wait for each other.
typedef struct EyeboxRefiner EyeboxRefiner;

// A scene as a light field. Its views are from a grid of positions in the pupil plane, and have the size of the
// display's pictures. It never changes.
typedef struct EyeboxScene EyeboxScene;

// A session, which shows a hologram on a display that the caller drives. Each tick gives the next video frame.
// Refinement runs on threads of the session. Calls with one session wait for each other, except for
// `eyebox_session_look` and `eyebox_session_look_moving`.
typedef struct EyeboxSession EyeboxSession;

// A function of the caller that uses the queue. `user` is the pointer that `eyebox_engine_with_queue` received. The
// function must not throw. It must not call eyebox with the same engine, or with a refiner or session that computes on
// it.
typedef void (*EyeboxUse)(void *user);

// A light field of the caller. Each color is an array (view row, view column, row, column) of float32 without gaps.
// The values are linear light, finite and not negative, with 1 as full scale. View (r, c) is the view from
// x = (c - (view_columns - 1) / 2) * view_pitch_m, y = (r - (view_rows - 1) / 2) * view_pitch_m in the pupil plane.
// Columns of views go to the right, and rows of views go down.
typedef struct {
  // The name that holograms store as their scene, or null for no name.
  const char *name;
  // Number of rows of views, 1 to 64.
  size_t view_rows;
  // Number of columns of views, 1 to 64.
  size_t view_columns;
  // Rows of each view (pixels). Views of another size than the display's pictures are scaled to fit completely.
  size_t rows;
  // Columns of each view (pixels).
  size_t columns;
  // Distance of neighboring views in the pupil plane (m). 0 spreads the views over the display's eyebox.
  double view_pitch_m;
  // The values of red, or null without red. At least one of the three colors must not be null.
  const float *red;
  // The values of green, or null without green.
  const float *green;
  // The values of blue, or null without blue.
  const float *blue;
  // Number of values of each of these arrays, which is view_rows * view_columns * rows * columns.
  size_t count;
  // The true order of the views, if it differs from the order of the arrays. It is one or several of "transpose",
  // "flip-rows" and "flip-columns" with commas between them. The order "as-named" states that the views are a grid
  // in the order of the arrays, for any content of their pictures. Null states no order.
  const char *order;
} EyeboxViews;

// The progress of a solve. Colors are solved one after the other.
typedef struct {
  // The present color, which is EYEBOX_RED, EYEBOX_GREEN or EYEBOX_BLUE.
  uint32_t color;
  // Number of steps taken for this color.
  size_t step;
  // Number of requested steps per color.
  size_t steps;
  // Number of steps taken by the short solves that choose the exposure. These run before the first step. It is 0
  // while they do not run.
  size_t pilot_step;
  // Total number of steps of these short solves. It is 0 while they do not run.
  size_t pilot_steps;
  // Time since the start of this color (s).
  double seconds;
  // Mean squared difference from the target images over the pupils of this step, in linear light. It is NaN before
  // any step, including the steps of the short solves.
  double loss;
  // Mean PSNR of the best state until now over validation pupils (dB). It is NaN before the first validation, and
  // for a black scene.
  double psnr_db;
} EyeboxStep;

// A function of the caller that `eyebox_solve` calls before the first step and after every step, on the thread that
// called `eyebox_solve`. Before the first step, the number of the step is 0 and the loss may be NaN. The argument
// `step` is valid during the call, and `user` is the pointer that `eyebox_solve` received. Return 0 to continue. Any
// other value ends the solve with the best result until then, and each remaining color gets one step.
// The function must not throw, and must not call eyebox with the engine of the solve.
typedef int32_t (*EyeboxProgress)(const EyeboxStep *step, void *user);

// The sizes of a hologram and of its reconstructions.
typedef struct {
  // Number of colors, 1 to 3.
  size_t colors;
  // The colors in their order, as EYEBOX_RED, EYEBOX_GREEN or EYEBOX_BLUE. An entry is 0 if there is no such color,
  // or if the color has no name.
  uint32_t color[3];
  // Number of sub-frames per color.
  size_t frames;
  // Rows of the phases (pixels of the SLM).
  size_t rows;
  // Columns of the phases (pixels of the SLM).
  size_t columns;
  // Rows of the image that an eye sees (pixels).
  size_t picture_rows;
  // Columns of the image that an eye sees (pixels).
  size_t picture_columns;
} EyeboxSize;

// The position, diameter and focus of a pupil of the eye, in meters.
typedef struct {
  // Center of the pupil along the columns (m). Positive values are to the right.
  double x_m;
  // Center of the pupil along the rows (m). Positive values are down.
  double y_m;
  // Diameter of the pupil (m). The diameter of an eye's pupil is 2e-3 to 8e-3.
  double diameter_m;
  // Depth of the focus, measured from the SLM's image (m). Positive values are nearer to the eye.
  double depth_m;
} EyeboxPupil;

// The score of an image through one pupil against the target image.
typedef struct {
  // PSNR over all colors (dB). It is NaN if the target is black.
  double psnr_db;
  // The ceiling, which is the highest PSNR of any hologram through this pupil (dB). It is NaN if it is unknown.
  double ceiling_db;
  // Mean SSIM over the colors. It is NaN if the picture is smaller than SSIM's window.
  double ssim;
  // PSNR of the image with an obstruction against the image of the same hologram through a clear pupil (dB). It is
  // NaN for a clear pupil.
  double against_clear_db;
} EyeboxScore;

// The shape of the video frames of a hologram. Their bytes are an array (frame, row, column, channel) of 8-bit values.
// The frames are in the order in which the display shows them.
typedef struct {
  // Number of video frames.
  size_t frames;
  // Rows of each video frame (pixels).
  size_t rows;
  // Columns of each video frame (pixels).
  size_t columns;
  // Number of channels, which is 1 (gray) or 3 (red, green, blue).
  size_t channels;
  // Size of the memory that a call fills, in bytes. It holds all video frames for `eyebox_encode`, and one video
  // frame for `eyebox_session_tick`.
  size_t bytes;
} EyeboxVideo;

// A sample of the caller's eye tracker.
typedef struct {
  // Center of the pupil along the columns (m, -0.1 to 0.1). Positive values are to the right. NaN states that the
  // eye is closed.
  double x_m;
  // Center of the pupil along the rows (m, -0.1 to 0.1). Positive values are down. NaN states that the eye is
  // closed.
  double y_m;
  // Diameter of the pupil (m, 0 to 0.02). Set it to 0 or NaN if the tracker does not measure it.
  double diameter_m;
  // Age of the sample (s, 0 to 10), which is the latency of the tracker and of the connection to it.
  double age_s;
} EyeboxSample;

// The description of the video frame that a tick gave.
typedef struct {
  // 1 if there is a video frame. It is 0 after the end of the content, and then the tick wrote no picture.
  int32_t shown;
  // 1 if a multiplex set begins with this video frame, otherwise 0. If `set` is unchanged, the same set repeats.
  int32_t begins;
  // Index of the video frame in its multiplex set, from 0.
  uint64_t part;
  // Number of the video frame of the display, from 0. Video frames without a tick count too.
  uint64_t number;
  // Number of the refined set, or of the hologram. It is -1 for the idle picture that is shown before the first set.
  int64_t set;
} EyeboxFrame;

// The statistics of a session. Without refinement, the counts from `steps` on are 0 and the times are NaN.
typedef struct {
  // Number of video frames of the display, taken or missed.
  uint64_t video_frames;
  // Number of these video frames for which no tick came in time.
  uint64_t missed;
  // Number of multiplex sets that began.
  uint64_t sets;
  // Number of these sets that show the idle picture, which precedes the first content.
  uint64_t idle_sets;
  // Number of refinement steps over all colors.
  uint64_t steps;
  // Number of sets that were new.
  uint64_t sets_new;
  // Number of sets that were shown again.
  uint64_t sets_repeated;
  // Number of restarts of the refinement after a jump of the eye.
  uint64_t restarts;
  // Median time from a sample to its first light (ms).
  double sample_to_light_ms;
  // Age of the newest sample at the newest light (ms).
  double sample_age_ms;
} EyeboxAccount;

#ifdef __cplusplus
extern "C" {
#endif // __cplusplus

// Returns the version of the library's interface. If it differs from `EYEBOX_INTERFACE`, the program was compiled for
// another version and must not continue.
uint32_t eyebox_interface(void);

// Returns the cause of the last failed call of this thread, as one sentence in UTF-8 of at most 2047 bytes. It is empty
// before the first failure. eyebox owns the text. It stays valid and unchanged until the same thread ends, or calls `eyebox_last_error`
// after another failure.
const char *eyebox_last_error(void);

// Returns the code of the last failed call of this thread, such as `scene/missing-view`. It is empty before the first
// failure. The code of an error never changes, but its sentence may change. eyebox owns the text. It stays valid until
// the same thread ends, or calls `eyebox_last_error_code` after another failure.
const char *eyebox_last_error_code(void);

// Makes a display from the name of a preset, such as "paper", "small" or "planes8", or from the path of a display file
// (TOML, docs/displays.md). Free it with `eyebox_display_free`. Fails with EYEBOX_STATUS_DISPLAY if there is no such
// preset or file, or if the file is wrong.
EyeboxStatus eyebox_display_load(const char *name, EyeboxDisplay **display);

// Makes a display from the text of a display file (TOML, docs/displays.md). Paths in the text are relative to the
// working folder. Free it with `eyebox_display_free`. Fails with EYEBOX_STATUS_DISPLAY if the text is wrong.
EyeboxStatus eyebox_display_from_toml(const char *toml, EyeboxDisplay **display);

// Makes a copy of a display with another number of rows and columns (pixels). Free it with `eyebox_display_free`.
// Fails with EYEBOX_STATUS_DISPLAY if a color of the display cannot have this size.
EyeboxStatus eyebox_display_resized(const EyeboxDisplay *display, size_t rows, size_t columns, EyeboxDisplay **resized);

// Frees a display. Null is allowed and has no effect.
void eyebox_display_free(EyeboxDisplay *display);

// Opens an engine. "cpu" computes on the CPU. "vulkan" computes on a Vulkan device, which may be a device in software.
// "auto" chooses a real GPU if one computes correctly, and otherwise the CPU. Free the engine with
// `eyebox_engine_free`. Fails with EYEBOX_STATUS_ARGUMENT if `choice` is another text. Fails with EYEBOX_STATUS_ENGINE
// if there is no usable device.
EyeboxStatus eyebox_engine_open(const char *choice, EyeboxEngine **engine);

// Writes a pointer to a sentence into `reason`. The sentence names the device of the engine and the reason for this
// choice. The engine owns it, and it stays valid until the engine is freed.
EyeboxStatus eyebox_engine_reason(const EyeboxEngine *engine, const char **reason);

// Frees an engine. Refiners and sessions that were made with it continue to work. Null is allowed and has no effect.
void eyebox_engine_free(EyeboxEngine *engine);

// Makes an engine on the caller's own Vulkan device. The types of the handles `instance`, `physical_device`, `device`
// and `queue` are VkInstance, VkPhysicalDevice, VkDevice and VkQueue. The queue belongs to `queue_family`, which must
// support VK_QUEUE_COMPUTE_BIT. The instance and the device must have Vulkan 1.2 or newer
// (VkApplicationInfo::apiVersion). The device must be made with the feature timelineSemaphore
// (VkPhysicalDeviceVulkan12Features), and needs no extension.
//
// eyebox checks the limits, the version, the queue family, and the results of small transforms. It cannot check the
// enabled features, because Vulkan does not report them. Without timelineSemaphore the calls are undefined.
//
// The caller keeps the device and its instance. Both must exist until the engine, and all refiners and sessions that
// were made with it, are freed. Until then the caller may use the queue only within `eyebox_engine_with_queue`. Free
// the engine with `eyebox_engine_free`.
//
// Fails with EYEBOX_STATUS_ENGINE if the device is not suitable. eyebox does not reopen a lost device, and later calls
// fail with EYEBOX_STATUS_ENGINE.
EyeboxStatus eyebox_engine_vulkan_device(void *instance,
                                         void *physical_device,
                                         void *device,
                                         uint32_t queue_family,
                                         void *queue,
                                         EyeboxEngine **engine);

// Calls `with(user)` once, while eyebox does not use the queue of the engine's device. In `with` the caller may submit
// its own work to the queue. It runs on the calling thread, before this function returns. Fails with
// EYEBOX_STATUS_ARGUMENT if the engine computes on the CPU.
EyeboxStatus eyebox_engine_with_queue(const EyeboxEngine *engine, EyeboxUse with, void *user);

// Loads a scene for a display. The `source` is "builtin:NAME", a folder of views, or a picture (docs/scenes.md). Set
// `colors` to a sum of EYEBOX_RED, EYEBOX_GREEN and EYEBOX_BLUE, or to 0 for all colors of the display. Set `views` to
// the number of views per axis of rendered scenes, 1 to 64, or to 0 for the default of the command. Free the scene
// with `eyebox_scene_free`.
//
// Fails with EYEBOX_STATUS_SCENE if the scene cannot be read, and with EYEBOX_STATUS_DISPLAY if the display lacks a
// color.
EyeboxStatus eyebox_scene_load(const char *source,
                               const EyeboxDisplay *display,
                               uint32_t colors,
                               size_t views,
                               EyeboxScene **scene);

// Makes a scene for a display from a light field of the caller. eyebox copies the views. Free the scene with
// `eyebox_scene_free`.
//
// Fails with EYEBOX_STATUS_ARGUMENT if `count` does not match the sizes or `order` is unknown. Fails with
// EYEBOX_STATUS_SCENE if the views are wrong, such as values that are not finite or views that are not a grid. Fails
// with EYEBOX_STATUS_DISPLAY if the display lacks a color.
EyeboxStatus eyebox_scene_from_views(const EyeboxViews *views, const EyeboxDisplay *display, EyeboxScene **scene);

// Frees a scene. Null is allowed and has no effect.
void eyebox_scene_free(EyeboxScene *scene);

// Solves a scene for a display as one hologram with all colors of the scene. Free the hologram with
// `eyebox_hologram_free`. The argument `progress` may be null, and so may `user`.
//
// Set `settings` to a TOML text, or to null for the defaults. The keys are the fields of eyebox::solve::Settings
// (docs/settings.md), such as "steps = 60", "pupils = 16", "frames = 8", "seed = 1", "seconds = 2.5" or "psnr = 30.0".
// Depths and diameters are in meters, as in "depth = [-1e-3, 2e-3]". The keys "quality" ("fast", "balanced",
// "accurate"), "contrast" and "force" have the same meaning as in the command.
//
// The same scene, display, settings and seed give the same phases as the command, bit for bit on the CPU engine.
//
// Fails with EYEBOX_STATUS_SOLVE if a key is unknown, if a value is wrong, or if a loss is not finite.
EyeboxStatus eyebox_solve(const EyeboxScene *scene,
                          const EyeboxDisplay *display,
                          const char *settings,
                          const EyeboxEngine *engine,
                          EyeboxProgress progress,
                          void *user,
                          EyeboxHologram **hologram);

// Opens a hologram from a folder that the command or `eyebox_hologram_save` made. Free it with `eyebox_hologram_free`.
// Fails with EYEBOX_STATUS_HOLOGRAM if the folder cannot be read or its contents are damaged.
EyeboxStatus eyebox_hologram_open(const char *path, EyeboxHologram **hologram);

// Saves a hologram in the format of the file extension. The extension .zarr saves the whole hologram, and .npy saves
// its phases alone. A hologram at `path` is replaced, and anything else there is refused. The old hologram stays until
// the new one is complete. After a failure (EYEBOX_STATUS_HOLOGRAM) nothing has changed at `path`.
EyeboxStatus eyebox_hologram_save(const EyeboxHologram *hologram, const char *path);

// Writes the sizes of a hologram into `size`.
EyeboxStatus eyebox_hologram_size(const EyeboxHologram *hologram, EyeboxSize *size);

// Loads the scene from which a hologram was solved, with the settings of the solve. If `source` is not null, it is the
// place of the scene. Otherwise eyebox searches for the scene. If `other_scene` is 0, eyebox refuses another scene,
// and a scene that has changed since the solve. Free the scene with `eyebox_scene_free`.
//
// Fails with EYEBOX_STATUS_HOLOGRAM if the scene is not found or is refused. Fails with EYEBOX_STATUS_SCENE if it
// cannot be read.
EyeboxStatus eyebox_scene_of_hologram(const EyeboxHologram *hologram,
                                      const char *source,
                                      int32_t other_scene,
                                      EyeboxScene **scene);

// Makes the display for a hologram. If `name` is not null, it is a preset or the path of a display file. Otherwise
// eyebox uses the display of the solve. The display of the solve is cut to the hologram's size, as it was then, and
// has its present encoding. Free the display with `eyebox_display_free`.
//
// Fails with EYEBOX_STATUS_HOLOGRAM if the display of the solve no longer exists or has other optics now. Fails with
// EYEBOX_STATUS_DISPLAY if a display cannot be read.
EyeboxStatus eyebox_hologram_display(const EyeboxHologram *hologram, const char *name, EyeboxDisplay **display);

// Writes a pointer to the phases of a color into `phases`, and their number into `count`. The argument `color` is the
// index of the color, less than `colors` of `EyeboxSize`. The phases are an array (sub-frame, row, column) in radians,
// with frames * rows * columns values. They are in the memory of the hologram, and stay valid until it is freed. Fails
// with EYEBOX_STATUS_ARGUMENT if there is no such color.
EyeboxStatus eyebox_hologram_phases(const EyeboxHologram *hologram, size_t color, const float **phases, size_t *count);

// Writes a pointer to the metadata of a hologram into `json`. They describe its solve as JSON text, as in its file
// (docs/hologram-format.md). The hologram owns the text, and it stays valid until the hologram is freed.
EyeboxStatus eyebox_hologram_metadata(const EyeboxHologram *hologram, const char **json);

// Computes the image that an eye sees of a hologram through a pupil, and writes it into `light`. The image is an array
// (color, row, column) in linear light, with 1 as the full scale of the scene. Set `count` to the number of values in
// `light`, which must be colors * picture_rows * picture_columns of `EyeboxSize`. The `obstruction` puts opaque marks
// into the pupil, and is "lashes", "floaters", "opacity" or "scratches", or null for a clear pupil.
//
// Fails with EYEBOX_STATUS_DISPLAY if the light does not reach the pupil, if no eye has such a pupil, or if the
// obstruction is unknown. Fails with EYEBOX_STATUS_ARGUMENT if `count` differs, and with EYEBOX_STATUS_ENGINE if the
// engine fails.
EyeboxStatus eyebox_view(const EyeboxHologram *hologram,
                         const EyeboxPupil *pupil,
                         const char *obstruction,
                         const EyeboxEngine *engine,
                         float *light,
                         size_t count);

// Compares the images of a hologram through `count` pupils with the target images of a scene, and writes one score per
// pupil into `scores`. Both arrays have `count` elements, at least 1. One exposure per color holds for all pupils. The
// scene must be loaded for the hologram's display and have its colors. If `scene` is null, eyebox loads the scene from
// which the hologram was solved, with the settings of the solve. The `obstruction` is the same as for `eyebox_view`.
//
// Fails with the statuses of `eyebox_view`. Fails also with EYEBOX_STATUS_HOLOGRAM if the scene is not found, is not
// the scene of the hologram, or has another size.
EyeboxStatus eyebox_score(const EyeboxHologram *hologram,
                          const EyeboxScene *scene,
                          const EyeboxPupil *pupils,
                          size_t count,
                          const char *obstruction,
                          const EyeboxEngine *engine,
                          EyeboxScore *scores);

// Frees a hologram with its phases and its metadata. Null is allowed and has no effect.
void eyebox_hologram_free(EyeboxHologram *hologram);

// Makes a refiner, which refines a copy of a hologram for the position of the pupil. The scene must be loaded for the
// hologram's display and have its colors. If `scene` is null, eyebox loads the scene from which the hologram was
// solved, with the settings of the solve. Hologram and scene may be freed after this call. The refiner computes on the
// device of `engine`, with engines of its own. Free it with `eyebox_refiner_free`.
//
// Set `settings` to a TOML text, or to null for the defaults. The keys are the fields of eyebox::solve::RefineSettings
// (docs/settings.md), such as "pupils = 2", "elsewhere = 0.5" or "seed = 1".
//
// Fails with EYEBOX_STATUS_SOLVE if the settings are wrong. Fails with EYEBOX_STATUS_HOLOGRAM if the scene is not
// found, is not the scene of the hologram, or has another size. Fails with EYEBOX_STATUS_DISPLAY if the scene lacks a
// color of the hologram.
EyeboxStatus eyebox_refiner_new(const EyeboxHologram *hologram,
                                const EyeboxScene *scene,
                                const char *settings,
                                const EyeboxEngine *engine,
                                EyeboxRefiner **refiner);

// Sets the pupil for which the next steps refine. The uncertainty of its center is `spread_m`, which is a standard
// deviation along each axis (0 to 0.1 m). Fails with EYEBOX_STATUS_DISPLAY if the light does not reach the pupil, or
// if no eye has such a pupil.
EyeboxStatus eyebox_refiner_aim(const EyeboxRefiner *refiner, const EyeboxPupil *pupil, double spread_m);

// Takes `steps` steps (1 to 1000000) of every color. If `loss` is not null, it receives the loss of the last step. The
// loss is the mean squared difference in linear light over the pupils of the step. Fails with EYEBOX_STATUS_SOLVE if a
// loss is not finite, and then this step was not taken.
EyeboxStatus eyebox_refiner_step(const EyeboxRefiner *refiner, size_t steps, double *loss);

// Takes `steps` steps (1 to 1000000) like `eyebox_refiner_step`, and makes a new hologram from the best state. The
// state after each step is scored at the pupil of `eyebox_refiner_aim`, so more steps never lower the score there.
// Free the hologram with `eyebox_hologram_free`. Fails with EYEBOX_STATUS_SOLVE if a loss is not finite.
EyeboxStatus eyebox_refiner_best(const EyeboxRefiner *refiner, size_t steps, EyeboxHologram **hologram);

// Makes a new hologram from the current state of a refiner. The program may render, encode or save it while the
// refiner continues. Free it with `eyebox_hologram_free`.
EyeboxStatus eyebox_refiner_hologram(const EyeboxRefiner *refiner, EyeboxHologram **hologram);

// Frees a refiner. Null is allowed and has no effect.
void eyebox_refiner_free(EyeboxRefiner *refiner);

// Makes an encoder for a display and for holograms with the given colors and number of sub-frames. Set `colors` to a
// sum of EYEBOX_RED, EYEBOX_GREEN and EYEBOX_BLUE, or to 0 for all colors of the display. Set `frames` to the number
// of sub-frames per color, 1 to 4096. This function reads the calibration files of the display, and later calls do
// not. Free the encoder with `eyebox_encoder_free`.
//
// Fails with EYEBOX_STATUS_DISPLAY if the display lacks a color. Fails with EYEBOX_STATUS_ENCODE if the display cannot
// show these colors and sub-frames, or if its calibration is wrong.
EyeboxStatus eyebox_encoder_new(const EyeboxDisplay *display, uint32_t colors, size_t frames, EyeboxEncoder **encoder);

// Writes the shape and size of the video frames of `eyebox_encode` into `video`.
EyeboxStatus eyebox_encoder_video(const EyeboxEncoder *encoder, EyeboxVideo *video);

// Encodes a hologram into `video`, which is memory of the caller with the number of `bytes` from
// `eyebox_encoder_video`. Fails with EYEBOX_STATUS_ARGUMENT if the hologram has other colors or another size than the
// encoder, or if `bytes` differs. Fails with EYEBOX_STATUS_ENCODE if the number of sub-frames differs.
EyeboxStatus eyebox_encode(const EyeboxEncoder *encoder, const EyeboxHologram *hologram, void *video, size_t bytes);

// Frees an encoder. Null is allowed and has no effect.
void eyebox_encoder_free(EyeboxEncoder *encoder);

// Starts a session that shows a hologram as it was solved. The display shows `rate_hz` video frames per second (0.001
// to 100000). The hologram and the display may be freed after this call. Free the session with `eyebox_session_free`.
//
// Fails with EYEBOX_STATUS_SESSION if the rate is outside its range, or if the hologram has another size than the
// display. Fails with EYEBOX_STATUS_ENCODE if the display cannot show the colors and sub-frames of the hologram.
EyeboxStatus eyebox_session_play(const EyeboxHologram *hologram,
                                 const EyeboxDisplay *display,
                                 double rate_hz,
                                 EyeboxSession **session);

// Starts a session that shows a hologram and refines it for the pupil of `eyebox_session_look`. The scene must be
// loaded for the hologram's display and have its colors. If `scene` is null, eyebox loads the scene from which the
// hologram was solved, with the settings of the solve. The video frames are encoded for `display`, which shows
// `rate_hz` video frames per second (0.001 to 100000). The session computes on the device of `engine`, with engines of
// its own. All handles may be freed after this call. Free the session with `eyebox_session_free`.
//
// Set `settings` to a TOML text, or to null for the defaults. The keys are the same as for `eyebox_refiner_new`.
//
// Fails with EYEBOX_STATUS_SOLVE if the settings are wrong. Fails with EYEBOX_STATUS_HOLOGRAM if the scene is not
// found, is not the scene of the hologram, or has another size. Fails with EYEBOX_STATUS_ENCODE if the display cannot
// show the colors and sub-frames of the hologram. Fails with EYEBOX_STATUS_SESSION if the rate is outside its range,
// if the hologram has another size than the display, or if the scene lacks a color of the hologram.
EyeboxStatus eyebox_session_follow(const EyeboxHologram *hologram,
                                   const EyeboxScene *scene,
                                   const EyeboxDisplay *display,
                                   const char *settings,
                                   const EyeboxEngine *engine,
                                   double rate_hz,
                                   EyeboxSession **session);

// Writes the shape of the pictures of `eyebox_session_tick` into `video`. The field `frames` is the number of video
// frames per multiplex set, and `bytes` is the size of one of them.
EyeboxStatus eyebox_session_video(const EyeboxSession *session, EyeboxVideo *video);

// Gives a sample of the caller's eye tracker to a session that follows the eye. It never waits, and any thread may
// call it while another thread ticks. Fails with EYEBOX_STATUS_ARGUMENT if a value is outside its range, or if
// `eyebox_session_play` started the session.
EyeboxStatus eyebox_session_look(const EyeboxSession *session, const EyeboxSample *sample);

// Gives a sample like `eyebox_session_look`, with the velocity of the pupil from the tracker. The velocity is `x_m_s`
// to the right and `y_m_s` down (m/s). Set it to NaN if it is unknown.
EyeboxStatus eyebox_session_look_moving(const EyeboxSession *session,
                                        const EyeboxSample *sample,
                                        double x_m_s,
                                        double y_m_s);

// Turns refinement for the tracked pupil on or off. If `steered` is 0, the session shows the hologram for the whole
// eyebox. Any other value turns refinement on.
EyeboxStatus eyebox_session_steer(const EyeboxSession *session, int32_t steered);

// Writes the next video frame into `picture`, and its description into `frame`. The picture is an array (row, column,
// channel) of 8-bit values in memory of the caller, and `bytes` must be the size from `eyebox_session_video`. Set
// `lit_in_s` to the time until the frame lights up (s, 0 to 1). Refinement predicts the pupil for this time. Call this
// function once for every video frame of the display, on any thread. It waits neither for a step nor for an encoding.
//
// Fails with EYEBOX_STATUS_ARGUMENT if `bytes` differs or `lit_in_s` is outside its range.
EyeboxStatus eyebox_session_tick(const EyeboxSession *session,
                                 double lit_in_s,
                                 void *picture,
                                 size_t bytes,
                                 EyeboxFrame *frame);

// Writes the statistics of a session, as of its last tick, into `account`.
EyeboxStatus eyebox_session_account(const EyeboxSession *session, EyeboxAccount *account);

// Ends a session with its threads, and frees it. Null is allowed and has no effect.
void eyebox_session_free(EyeboxSession *session);

#ifdef __cplusplus
}  // extern "C"
#endif  // __cplusplus

#endif  /* EYEBOX_H */
