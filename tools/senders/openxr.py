#!/usr/bin/env python3
"""Sends the gaze of an OpenXR headset to eyebox (pip install pyopenxr).

It needs a runtime with XR_EXT_eye_gaze_interaction and, because it draws nothing, XR_MND_headless. The gaze is common
to both eyes, without vergence or diameter. The program follows the specification and is not yet tested on a headset.
Run openxr.py --simulate to test the connection without one.
"""

import ctypes, time
from sender import Sender, arguments, gaze, simulate

GAZE = "XR_EXT_eye_gaze_interaction"
HEADLESS = "XR_MND_headless"


def forward(q):
    """Returns the direction of a pose, which is its axis -z, as (right, up, forward)."""
    right = -2 * (q.x * q.z + q.w * q.y)
    up = -2 * (q.y * q.z - q.w * q.x)
    return right, up, 1 - 2 * (q.x * q.x + q.y * q.y)


def poses(xr):
    """Yields the orientation of the gaze relative to the head, or None, 100 times per second."""
    instance = xr.create_instance(xr.InstanceCreateInfo(enabled_extension_names=[GAZE, HEADLESS]))
    system = xr.get_system(instance, xr.SystemGetInfo(xr.FormFactor.HEAD_MOUNTED_DISPLAY))
    session = xr.create_session(instance, xr.SessionCreateInfo(system_id=system))
    actions = xr.create_action_set(instance, xr.ActionSetCreateInfo("eyes", "Eyes", 0))
    look = xr.create_action(actions, xr.ActionCreateInfo("look", xr.ActionType.POSE_INPUT, localized_action_name="Look"))
    path = xr.string_to_path(instance, "/user/eyes_ext/input/gaze_ext/pose")
    profile = xr.string_to_path(instance, "/interaction_profiles/ext/eye_gaze_interaction")
    bound = [xr.ActionSuggestedBinding(look, path)]
    xr.suggest_interaction_profile_bindings(instance, xr.InteractionProfileSuggestedBinding(profile, bound))
    xr.attach_session_action_sets(session, xr.SessionActionSetsAttachInfo([actions]))
    eyes = xr.create_action_space(session, xr.ActionSpaceCreateInfo(look))
    head = xr.create_reference_space(session, xr.ReferenceSpaceCreateInfo(xr.ReferenceSpaceType.VIEW))
    running = False
    while True:
        try:
            event = xr.poll_event(instance)
            if xr.StructureType(event.type) == xr.StructureType.EVENT_DATA_SESSION_STATE_CHANGED:
                state = ctypes.cast(ctypes.byref(event), ctypes.POINTER(xr.EventDataSessionStateChanged)).contents.state
                if xr.SessionState(state) == xr.SessionState.READY:
                    xr.begin_session(session, xr.SessionBeginInfo(xr.ViewConfigurationType.PRIMARY_STEREO))
                    running = True
            continue
        except xr.EventUnavailable:
            pass
        if running:
            frame = xr.wait_frame(session, xr.FrameWaitInfo())
            xr.begin_frame(session, xr.FrameBeginInfo())
            xr.end_frame(session, xr.FrameEndInfo(frame.predicted_display_time, xr.EnvironmentBlendMode.OPAQUE))
            active = (xr.ActiveActionSet * 1)(xr.ActiveActionSet(actions, xr.NULL_PATH))
            xr.sync_actions(session, xr.ActionsSyncInfo(active_action_sets=active))
            seen = xr.locate_space(eyes, head, frame.predicted_display_time)
            yield seen.pose.orientation if seen.location_flags & xr.SPACE_LOCATION_ORIENTATION_TRACKED_BIT else None
        time.sleep(0.01)


def main():
    args = arguments(__doc__)
    sender = Sender(args)
    if args.simulate:
        return simulate(sender.send, both=False)
    import xr

    for pose in poses(xr):
        eye = gaze(forward(pose)) if pose else gaze((0, 0, 0), False)
        if not sender.send({"t": time.monotonic(), **eye}):
            return


if __name__ == "__main__":
    main()
