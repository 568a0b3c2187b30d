// eyebox: phase holograms for near-eye displays, from C and C++. Made of tools/c by cbindgen: change it there.
//
// Pointers. Texts are UTF-8 and end with a zero byte; arrays come with the number of their values, which is compared with what
// the function takes before anything is read or written. Where nothing else is said a pointer must not be null. Handles are made by
// functions that put them into a place of yours (null where they fail) and freed by theirs, once; `free` takes null. What a
// handle was made of may be freed before it. Freeing one that is in use, or twice, is undefined, as everywhere in C.
//
// Errors. Every function answers EYEBOX_STATUS_OK or what was wrong; `eyebox_last_error` says it in a sentence, per thread. That text
// stays valid until the same thread calls `eyebox_last_error` after another failure: other calls, and other threads, leave it alone.
//
// Threads. Any thread may call anything. Displays, scenes, holograms and encoders never change: any number of threads may use one at
// once. Calls with one engine, one refiner or one session wait for each other, but for eyebox_session_look, which waits for nobody;
// engines are cheap beside what they compute, open one a thread. eyebox computes on threads of its own, as many as RAYON_NUM_THREADS
// says or there are cores; a session has three more until it is freed. Threads do not survive fork: a child that was forked after an engine was opened, a
// scene was made or a session was started is refused with EYEBOX_STATUS_ENGINE, and freeing does nothing there.
//
// Units. Lengths are metres, phases radians, light linear, axis order (row = y, column = x), +x to the right, +y down.


#ifndef EYEBOX_H
#define EYEBOX_H

#include <stddef.h>
#include <stdint.h>

// The interface that this header describes. It is raised with every change that a program has to be compiled anew for.
#define EYEBOX_INTERFACE 2

// Red, as one bit of a set of colours.
#define EYEBOX_RED 1

// Green.
#define EYEBOX_GREEN 2

// Blue.
#define EYEBOX_BLUE 4

// What a function answers. `eyebox_last_error` says the rest.
typedef enum {
  // It did what was asked.
  EYEBOX_STATUS_OK = 0,
  // A pointer that has to lead somewhere is null, or misaligned.
  EYEBOX_STATUS_POINTER = 1,
  // A number, a text or the length of an array is not one that the function takes.
  EYEBOX_STATUS_ARGUMENT = 2,
  // The display, or a pupil before it.
  EYEBOX_STATUS_DISPLAY = 3,
  // The scene, its file or its views.
  EYEBOX_STATUS_SCENE = 4,
  // The settings, or the solve or refinement that they ask for.
  EYEBOX_STATUS_SOLVE = 5,
  // The hologram, or its file.
  EYEBOX_STATUS_HOLOGRAM = 6,
  // The encoding, or what is to be encoded.
  EYEBOX_STATUS_ENCODE = 7,
  // The engine or its device.
  EYEBOX_STATUS_ENGINE = 8,
  // A fault of eyebox itself, please report it. Handles that the call was given may be freed, and no more.
  EYEBOX_STATUS_INTERNAL = 9,
  // The session, or what it shows on.
  EYEBOX_STATUS_SESSION = 10,
} EyeboxStatus;

// A display: the SLM, its optics and how it takes its phases. It never changes.
typedef struct EyeboxDisplay EyeboxDisplay;

// An encoder: phases of one shape to the video frames of one display. It never changes.
typedef struct EyeboxEncoder EyeboxEncoder;

// Where is computed: on the CPU, or on a Vulkan device. Calls with one engine wait for each other.
typedef struct EyeboxEngine EyeboxEngine;

// Phases, and what they were made for and by. It never changes.
typedef struct EyeboxHologram EyeboxHologram;

// A hologram under refinement, on engines of its own. Calls with one refiner wait for each other.
typedef struct EyeboxRefiner EyeboxRefiner;

// A scene as a light field: views from a grid of places in the pupil plane, of a display's size. It never changes.
typedef struct EyeboxScene EyeboxScene;

// A hologram on a display that the caller drives: each tick gives the video frame that is next. What is refined is refined
// meanwhile, on threads of its own.
typedef struct EyeboxSession EyeboxSession;

// What a caller does with its queue, with the pointer that was given to `eyebox_engine_with_queue`. It must not throw, nor call eyebox
// with that engine or anything that computes on it.
typedef void (*EyeboxUse)(void *user);

// A light field of the caller's own. Each colour is an array (view row, view column, row, column) without gaps, of linear light
// in float32, finite and not negative, with 1 as full scale. View (r, c) looks from x = (c - (view_columns - 1) / 2)
// view_pitch_m, y = (r - (view_rows - 1) / 2) view_pitch_m: columns of views go to the right, rows down.
typedef struct {
  // What holograms of it remember as their scene; null for nothing.
  const char *name;
  // Rows of views, 1 to 64.
  size_t view_rows;
  // Columns of views, 1 to 64.
  size_t view_columns;
  // Rows of each view. Views of another size than the display's pictures are scaled to fit whole.
  size_t rows;
  // Columns of each view.
  size_t columns;
  // Metres between neighbouring views in the pupil plane; 0 spreads them over the display's eyebox.
  double view_pitch_m;
  // Red; null where there is none. So for the others; at least one is there.
  const float *red;
  // Green.
  const float *green;
  // Blue.
  const float *blue;
  // Values of each of these arrays: view_rows view_columns rows columns.
  size_t count;
  // How views stand that do not stand as the arrays have them: "transpose", "flip-rows", "flip-columns", with commas between;
  // "as-named" takes them as a grid whatever their pictures show. Null for none of it.
  const char *order;
} EyeboxViews;

// How far a solve is. Colours are solved one after the other.
typedef struct {
  // The colour: EYEBOX_RED, EYEBOX_GREEN or EYEBOX_BLUE.
  uint32_t color;
  // Steps taken of this colour.
  size_t step;
  // Steps asked for.
  size_t steps;
  // Steps of the short solves that choose the exposure, taken and in all, while they run before the first step; else 0.
  size_t pilot_step;
  // All of them.
  size_t pilot_steps;
  // Seconds since this colour began.
  double seconds;
  // Mean squared difference from the photographs over this step's pupils, in linear light.
  double loss;
  // Mean PSNR of the best state so far over validation pupils, dB; NaN before there is one, and for a black scene.
  double psnr_db;
} EyeboxStep;

// Called after every step, on the thread that called `eyebox_solve`, with the pointer that was given there. What it answers: 0 to
// go on; anything else ends the solve with the best so far, colours that are left get one step each. It must not throw, nor
// call eyebox with the engine of the solve.
typedef int32_t (*EyeboxProgress)(const EyeboxStep *step, void *user);

// The sizes of a hologram, and of what is seen of it.
typedef struct {
  // Colours, 1 to 3.
  size_t colors;
  // Which they are, in their order: EYEBOX_RED, EYEBOX_GREEN, EYEBOX_BLUE; 0 where there is none, or it has no name.
  uint32_t color[3];
  // Sub-frames of each colour.
  size_t frames;
  // Rows of the SLM.
  size_t rows;
  // Columns.
  size_t columns;
  // Rows of what an eye sees.
  size_t picture_rows;
  // Columns of it.
  size_t picture_columns;
} EyeboxSize;

// Where the eye's pupil is, how wide it is, and where it focuses. Metres.
typedef struct {
  // Centre, to the right (along columns).
  double x_m;
  // Centre, down (along rows).
  double y_m;
  // Diameter; an eye's is 2e-3 to 8e-3.
  double diameter_m;
  // Where it focuses, from the SLM's image; positive is nearer.
  double depth_m;
} EyeboxPupil;

// What a pupil sees, against what it should see.
typedef struct {
  // PSNR over all colors, dB; NaN if the target is black.
  double psnr_db;
  // The most that any hologram could have there, dB; NaN where it is not known.
  double ceiling_db;
  // Mean SSIM over the colours; NaN where the picture is smaller than SSIM's window.
  double ssim;
  // PSNR of the image past an obstruction against the image that the same hologram shows a clear pupil, dB; NaN for a clear pupil.
  double against_clear_db;
} EyeboxScore;

// The video frames of a hologram: (frame, row, column, channel), 8 bits each, in the order in which they are shown.
typedef struct {
  // How many.
  size_t frames;
  // Rows of a frame.
  size_t rows;
  // Columns.
  size_t columns;
  // 1 (grey) or 3 (red, green, blue).
  size_t channels;
  // Bytes of all of them.
  size_t bytes;
} EyeboxVideo;

// A sample of the caller's eye tracker.
typedef struct {
  // Where the pupil's centre was, metres to the right; NaN where the eye is closed.
  double x_m;
  // Down.
  double y_m;
  // Its diameter, metres; 0 or NaN if the tracker does not measure it.
  double diameter_m;
  // Seconds since it was there: what the tracker and its way here take, 0 to 10.
  double age_s;
} EyeboxSample;

// What a tick gave.
typedef struct {
  // Whether there is one: 0 once what is shown has ended, and then nothing was written.
  int32_t shown;
  // Whether a set begins with it; `set` says whether it is another one.
  int32_t begins;
  // Which video frame of its set, from 0.
  uint64_t part;
  // Which video frame of the display, from 0; those that no tick came for are counted.
  uint64_t number;
  // The number of the refined set, or of the hologram; -1 for the picture that is shown before there is any.
  int64_t set;
} EyeboxFrame;

// What a session did so far. Of what is not refined, the counts from `steps` on are 0 and the times NaN.
typedef struct {
  // Video frames of the display, taken or missed.
  uint64_t video_frames;
  // Of them, those that no tick came for in time.
  uint64_t missed;
  // Sets begun.
  uint64_t sets;
  // Of them, those of the picture that is shown before there is any.
  uint64_t idle_sets;
  // Steps of refinement, of all colours.
  uint64_t steps;
  // Sets that were new,
  uint64_t sets_new;
  // and that were shown again.
  uint64_t sets_repeated;
  // How often refinement began again, after a jump of the eye.
  uint64_t restarts;
  // From a sample to its first light, the median, milliseconds.
  double sample_to_light_ms;
  // How old the newest sample was at the newest light, milliseconds.
  double sample_age_ms;
} EyeboxAccount;

#ifdef __cplusplus
extern "C" {
#endif // __cplusplus

// The interface that the library has: a program that was compiled for another one (EYEBOX_INTERFACE) must not go on.
uint32_t eyebox_interface(void);

// Returns why the last call of this thread that failed did so: one sentence in UTF-8, empty before the first failure. The text stays
// valid and unchanged, whatever else fails, until the same thread calls `eyebox_last_error` after another failure, or ends.
const char *eyebox_last_error(void);

// Returns the code of the last failed call of this thread, such as `scene/missing-view`. The code of an error never changes, its
// sentence may. The code is empty before the first failure. The text stays valid until the same thread calls
// `eyebox_last_error_code` after another failure, or ends.
const char *eyebox_last_error_code(void);

// A display by the name of a preset, such as "paper", "small" or "planes8", or from a TOML file.
EyeboxStatus eyebox_display_load(const char *name, EyeboxDisplay **display);

// A display from the text of a display file (docs/displays.md). Files that it names lie in the working folder.
EyeboxStatus eyebox_display_from_toml(const char *toml, EyeboxDisplay **display);

// The same display with so many rows and columns of pixels.
EyeboxStatus eyebox_display_resized(const EyeboxDisplay *display, size_t rows, size_t columns, EyeboxDisplay **resized);

// Frees a display; null is nothing to free.
void eyebox_display_free(EyeboxDisplay *display);

// Opens an engine: "cpu"; "vulkan", a device in software included; or "auto": a real GPU where there is one that computes as it
// should, else the CPU.
EyeboxStatus eyebox_engine_open(const char *choice,
                                EyeboxEngine **engine);

// What computes, and why that and nothing else, in a sentence that stands as long as the engine.
EyeboxStatus eyebox_engine_reason(const EyeboxEngine *engine, const char **reason);

// Frees an engine; refiners that were made with it go on.
void eyebox_engine_free(EyeboxEngine *engine);

// An engine on the caller's own Vulkan device. `instance`, `physical_device`, `device` and `queue` are VkInstance, VkPhysicalDevice,
// VkDevice and VkQueue; the queue is one of `queue_family`, which computes (VK_QUEUE_COMPUTE_BIT). The instance and the device are
// of Vulkan 1.2 or newer (VkApplicationInfo::apiVersion), and the device was made with the feature timelineSemaphore
// (VkPhysicalDeviceVulkan12Features); no extension is needed. What Vulkan tells is looked at: limits, the version, whether the
// family computes, and whether small transforms come out right. Which features are on it tells nobody: without that one the
// calls are undefined. The device and its instance stay the caller's, and must stand until the engine, and all that was made
// with it (refiners, sessions), are freed. Until then the caller makes use of the queue within `eyebox_engine_with_queue`
// alone. A device that is lost is not opened anew: calls fail with EYEBOX_STATUS_ENGINE.
EyeboxStatus eyebox_engine_vulkan_device(void *instance,
                                         void *physical_device,
                                         void *device,
                                         uint32_t queue_family,
                                         void *queue,
                                         EyeboxEngine **engine);

// Calls `with` (`user`) while nothing of eyebox makes use of the queue of an engine's device: for what the caller submits there itself.
EyeboxStatus eyebox_engine_with_queue(const EyeboxEngine *engine,
                                      EyeboxUse with,
                                      void *user);

// Loads a scene for a display: "builtin:NAME", a folder of views, or a picture (docs/scenes.md), in the `colors` that are asked for
// (a sum of EYEBOX_RED, EYEBOX_GREEN, EYEBOX_BLUE; 0 for all of the display's). `views` are the views per axis of scenes that are
// rendered, 1 to 64; 0 for as many as the command takes.
EyeboxStatus eyebox_scene_load(const char *source,
                               const EyeboxDisplay *display,
                               uint32_t colors,
                               size_t views,
                               EyeboxScene **scene);

// Takes over a light field of the caller's own for a display. The views are copied.
EyeboxStatus eyebox_scene_from_views(const EyeboxViews *views, const EyeboxDisplay *display, EyeboxScene **scene);

// Frees a scene.
void eyebox_scene_free(EyeboxScene *scene);

// Solves a scene for a display: one hologram, in all of the scene's colours. `settings` is TOML, or null for the defaults: the fields
// of eyebox::solve::Settings by their names, such as "steps = 60", "pupils = 16", "frames = 8", "seed = 1", "seconds = 2.5",
// "psnr = 30.0", depths and diameters in metres ("depth = [-1e-3, 2e-3]"), and "quality" ("fast", "balanced", "accurate"),
// "contrast" and "force" as in the command. A key that is not known is refused. The same scene, display, settings and seed give the same
// phases as the command, bit for bit on the CPU engine. `progress` may be null.
EyeboxStatus eyebox_solve(const EyeboxScene *scene,
                          const EyeboxDisplay *display,
                          const char *settings,
                          const EyeboxEngine *engine,
                          EyeboxProgress progress,
                          void *user,
                          EyeboxHologram **hologram);

// Opens a hologram: a folder that the command or `eyebox_hologram_save` made.
EyeboxStatus eyebox_hologram_open(const char *path, EyeboxHologram **hologram);

// Saves a hologram by the ending of its name: .zarr is all of it, .npy its phases alone. A hologram that is there is replaced,
// anything else left alone, and nothing is left half written.
EyeboxStatus eyebox_hologram_save(const EyeboxHologram *hologram,
                                  const char *path);

// The sizes of a hologram.
EyeboxStatus eyebox_hologram_size(const EyeboxHologram *hologram, EyeboxSize *size);

// Loads the scene that a hologram was solved from, read as it was then: wherever it is found, or at `source` where that is not
// null. A scene that was changed since, and another scene, is refused unless `other_scene` is not 0.
EyeboxStatus eyebox_scene_of_hologram(const EyeboxHologram *hologram,
                                      const char *source,
                                      int32_t other_scene,
                                      EyeboxScene **scene);

// The display that a name or file says, or, where `name` is null, the one that the hologram was solved for; that is cut to the
// hologram's size, as it was then. Its encoding is that of today.
EyeboxStatus eyebox_hologram_display(const EyeboxHologram *hologram,
                                     const char *name,
                                     EyeboxDisplay **display);

// The phases of a colour, by its place: (sub-frame, row, column), radians, in the hologram's own memory. They stand as long as it
// does. `count` is frames rows columns.
EyeboxStatus eyebox_hologram_phases(const EyeboxHologram *hologram,
                                    size_t color,
                                    const float **phases,
                                    size_t *count);

// How a hologram was made: JSON, as its file has it (docs/hologram-format.md). It stands as long as the hologram.
EyeboxStatus eyebox_hologram_metadata(const EyeboxHologram *hologram, const char **json);

// What an eye sees through a pupil: (colour, row, column) in linear light, with 1 as the scene's full scale, into `light`, which has
// `count` values: colors picture_rows picture_columns. `obstruction` puts opaque marks into the pupil: "lashes", "floaters", "opacity",
// "scratches", or null for a clear pupil.
EyeboxStatus eyebox_view(const EyeboxHologram *hologram,
                         const EyeboxPupil *pupil,
                         const char *obstruction,
                         const EyeboxEngine *engine,
                         float *light,
                         size_t count);

// Compares what `count` pupils see with what they should see of the scene, with one exposure per colour for all of them, into
// `scores`, which has room for as many. The scene was loaded for the hologram's display and has its colours; null takes the one
// that the hologram was solved from, read as it was then. `obstruction` is as in eyebox_view.
EyeboxStatus eyebox_score(const EyeboxHologram *hologram,
                          const EyeboxScene *scene,
                          const EyeboxPupil *pupils,
                          size_t count,
                          const char *obstruction,
                          const EyeboxEngine *engine,
                          EyeboxScore *scores);

// Frees a hologram, and with it its phases and its metadata.
void eyebox_hologram_free(EyeboxHologram *hologram);

// Begins to refine a hologram for where the pupil is: a copy, the hologram stays as it is. The scene was loaded for the hologram's
// display, has its colours, and may be freed afterwards; null takes the one that the hologram was solved from, read as it was
// then. `settings` is TOML, or null for the defaults: the fields of
// eyebox::solve::RefineSettings by their names, such as "pupils = 2", "elsewhere = 0.5", "seed = 1". It computes where `engine` does,
// beside it.
EyeboxStatus eyebox_refiner_new(const EyeboxHologram *hologram,
                                const EyeboxScene *scene,
                                const char *settings,
                                const EyeboxEngine *engine,
                                EyeboxRefiner **refiner);

// The pupil is there from now on, its centre known to within `spread_m` (a standard deviation along each axis, metres).
EyeboxStatus eyebox_refiner_aim(const EyeboxRefiner *refiner, const EyeboxPupil *pupil, double spread_m);

// Takes so many steps of every colour. `loss` is that of the last, the mean squared difference in linear light over its pupils; it may be
// null. A loss that is no finite number is an error: the step was not taken.
EyeboxStatus eyebox_refiner_step(const EyeboxRefiner *refiner,
                                 size_t steps,
                                 double *loss);

// Takes at most so many steps as `eyebox_refiner_step` does and hands over the hologram in the best state that they reached, as a
// new one. The state after each step is judged at the pupil that was aimed at, as a score is: more steps are never worse there.
EyeboxStatus eyebox_refiner_best(const EyeboxRefiner *refiner,
                                 size_t steps,
                                 EyeboxHologram **hologram);

// The hologram as it is now, as a new one: to be looked at, encoded or saved while the refiner goes on.
EyeboxStatus eyebox_refiner_hologram(const EyeboxRefiner *refiner, EyeboxHologram **hologram);

// Frees a refiner.
void eyebox_refiner_free(EyeboxRefiner *refiner);

// An encoder for a display, for holograms of these colours (a sum of EYEBOX_RED, EYEBOX_GREEN and EYEBOX_BLUE; 0 for all of the
// display's) and so many sub-frames. The display's calibration is read now, once.
EyeboxStatus eyebox_encoder_new(const EyeboxDisplay *display,
                                uint32_t colors,
                                size_t frames,
                                EyeboxEncoder **encoder);

// The sizes of what `eyebox_encode` writes.
EyeboxStatus eyebox_encoder_video(const EyeboxEncoder *encoder, EyeboxVideo *video);

// Encodes a hologram into memory of the caller's, of as many bytes as `eyebox_encoder_video` says.
EyeboxStatus eyebox_encode(const EyeboxEncoder *encoder, const EyeboxHologram *hologram, void *video, size_t bytes);

// Frees an encoder.
void eyebox_encoder_free(EyeboxEncoder *encoder);

// Shows a hologram as it was solved, on a display of so many video frames a second.
EyeboxStatus eyebox_session_play(const EyeboxHologram *hologram,
                                 const EyeboxDisplay *display,
                                 double rate_hz,
                                 EyeboxSession **session);

// Shows a hologram that is refined for where the eye is, as `eyebox_session_look` says. The scene was loaded for the hologram's
// display, has its colours, and may be freed afterwards; null takes the one that the hologram was solved from, read as it was
// then. `display` is what is encoded for. `settings` is TOML, or null for the
// defaults: the fields of eyebox::solve::RefineSettings, as of `eyebox_refiner_new`. It computes where `engine` does, beside it.
EyeboxStatus eyebox_session_follow(const EyeboxHologram *hologram,
                                   const EyeboxScene *scene,
                                   const EyeboxDisplay *display,
                                   const char *settings,
                                   const EyeboxEngine *engine,
                                   double rate_hz,
                                   EyeboxSession **session);

// The sizes of what ticks give: `frames` video frames a set, and `bytes` of one of them.
EyeboxStatus eyebox_session_video(const EyeboxSession *session, EyeboxVideo *video);

// Gives a sample of the caller's eye tracker. It waits for nothing, a tick least of all.
EyeboxStatus eyebox_session_look(const EyeboxSession *session, const EyeboxSample *sample);

// The same of a tracker that tells how fast the pupil moves, metres a second: to the right, and down. NaN where it does not know.
EyeboxStatus eyebox_session_look_moving(const EyeboxSession *session,
                                        const EyeboxSample *sample,
                                        double x_m_s,
                                        double y_m_s);

// Whether a session that follows an eye does: 0 shows the hologram for the whole eyebox, anything else follows.
EyeboxStatus eyebox_session_steer(const EyeboxSession *session, int32_t steered);

// The video frame that is next, into memory of the caller's: (row, column, channel), 8 bits each, of as many bytes as
// `eyebox_session_video` says. It lights up in `lit_in_s` seconds, 0 to 1: what refinement aims at. Call it once for every video frame of
// the display, in any thread; it waits for no step, and for no encoding.
EyeboxStatus eyebox_session_tick(const EyeboxSession *session,
                                 double lit_in_s,
                                 void *picture,
                                 size_t bytes,
                                 EyeboxFrame *frame);

// What a session did so far, as of its last tick.
EyeboxStatus eyebox_session_account(const EyeboxSession *session, EyeboxAccount *account);

// Ends a session, and its threads with it.
void eyebox_session_free(EyeboxSession *session);

#ifdef __cplusplus
}  // extern "C"
#endif  // __cplusplus

#endif  /* EYEBOX_H */
