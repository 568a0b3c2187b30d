#!/usr/bin/env bash
# Makes this machine able to run everything: the Vulkan loader, a software Vulkan (lavapipe), the validation layer, the
# OpenXR loader with its validation layer and hello_xr, a virtual X display, Xorg's dummy driver, Weston,
# ffmpeg and a linker. Installs only what is missing, and says nothing when that is nothing.
# Debian, Ubuntu and their kin: by apt-get. Elsewhere: says what is missing and exits 1, or 0 if nothing is.
# Rust itself (cargo) is assumed.
# tools/setup.sh windows does the same for what builds for Windows and runs it: MinGW's linker and Wine, 1 GB on the disk.
# tools/setup.sh aarch64 for what tools/aarch64.sh builds and runs with: a cross compiler and qemu-user.
# tools/setup.sh site for what tools/site.sh opens its pages with: Chromium.
set -euo pipefail

say() { printf 'setup: %s\n' "$*" >&2; }

if ! command -v cargo >/dev/null; then
    say "cargo was not found: install Rust 1.91 or later from https://rustup.rs"
    exit 1
fi

windows=$([[ ${1:-} != windows ]] || echo yes)
site=$([[ ${1:-} != site ]] || echo yes)
aarch64=$([[ ${1:-} != aarch64 ]] || echo yes)
browser() { command -v chromium >/dev/null || command -v chromium-browser >/dev/null || command -v google-chrome >/dev/null; }
mingw() { command -v x86_64-w64-mingw32-gcc >/dev/null; }
wine() { (PATH=$PATH:/usr/lib/wine && command -v wine64 >/dev/null); } # Where Debian has it.

if command -v apt-get >/dev/null && command -v dpkg-query >/dev/null; then
    missing=()
    if [[ $windows ]]; then
        mingw || missing+=(gcc-mingw-w64-x86-64-win32)
        wine || missing+=(wine64)
    elif [[ $aarch64 ]]; then
        command -v aarch64-linux-gnu-gcc >/dev/null || missing+=(gcc-aarch64-linux-gnu libc6-dev-arm64-cross)
        command -v qemu-aarch64 >/dev/null || missing+=(qemu-user)
    elif [[ $site ]]; then
        browser || missing+=(chromium)
        python3 -c 'import ensurepip' 2>/dev/null || missing+=(python3-venv)
    else
        # What windows load at run time comes last.
        for package in libvulkan1 libvulkan-dev mesa-vulkan-drivers vulkan-validationlayers libopenxr-loader1 \
            libopenxr-dev openxr-layer-corevalidation libopenxr-utils xvfb \
            xserver-xorg-core xserver-xorg-video-dummy weston libx11-6 libx11-xcb1 libxcursor1 libxi6 libxkbcommon0 \
            libxkbcommon-x11-0 ffmpeg; do
            status=$(dpkg-query -W -f='${Status}' "$package" 2>/dev/null || true)
            [[ $status == "install ok installed" ]] || missing+=("$package")
        done
        # Rust links through the C compiler's driver.
        command -v cc >/dev/null || missing+=(gcc libc6-dev)
        # Programs in C find the library through these.
        command -v pkg-config >/dev/null || missing+=(pkg-config)
        command -v cmake >/dev/null || missing+=(cmake)
    fi
    ((${#missing[@]})) || exit 0

    as_root=()
    if ((EUID != 0)); then
        if ! command -v sudo >/dev/null; then
            say "missing: ${missing[*]}; as root, run: apt-get install ${missing[*]}"
            exit 1
        fi
        as_root=(sudo)
        # Without a terminal a password cannot be asked for.
        [[ -t 0 ]] || as_root=(sudo -n)
    fi
    say "installing ${missing[*]}"
    log=$(mktemp)
    trap 'rm -f "$log"' EXIT
    apt() { "${as_root[@]}" env DEBIAN_FRONTEND=noninteractive apt-get -q -o DPkg::Lock::Timeout=300 "$@" </dev/null >>"$log" 2>&1; }
    [[ ! -t 0 ]] || ((EUID == 0)) || sudo -v
    # Old package lists may be good enough; a machine without any, or with stale ones, needs new ones.
    if ! apt install -y --no-install-recommends "${missing[@]}"; then
        if ! { apt update && apt install -y --no-install-recommends "${missing[@]}"; }; then
            cat "$log" >&2
            say "apt-get failed (above); run by hand: apt-get install ${missing[*]}"
            exit 1
        fi
    fi
    say "done"
    exit 0
fi

missing=()
if [[ $windows ]]; then
    mingw || missing+=("MinGW's linker, x86_64-w64-mingw32-gcc")
    wine || missing+=("Wine for 64 bits, wine64")
elif [[ $aarch64 ]]; then
    command -v aarch64-linux-gnu-gcc >/dev/null || missing+=("a cross compiler, aarch64-linux-gnu-gcc")
    command -v qemu-aarch64 >/dev/null || missing+=("qemu-user")
elif [[ $site ]]; then
    browser || missing+=("Chromium")
else
    libraries=$({ ldconfig -p || /sbin/ldconfig -p; } 2>/dev/null || true)
    [[ $libraries == *libvulkan.so.1* ]] || missing+=("the Vulkan loader (libvulkan.so.1)")
    manifest() {
        local folder
        for folder in /usr/share /usr/local/share /etc "${XDG_DATA_HOME:-$HOME/.local/share}"; do
            compgen -G "$folder/vulkan/$1" >/dev/null && return
        done
        return 1
    }
    manifest 'icd.d/*.json' || missing+=("a Vulkan driver; Mesa's lavapipe runs on any CPU")
    manifest 'explicit_layer.d/*validation*.json' || missing+=("the Khronos validation layer")
    [[ $libraries == *libopenxr_loader.so.1* ]] || missing+=("the OpenXR loader (libopenxr_loader.so.1) with its headers")
    command -v Xvfb >/dev/null || missing+=("Xvfb")
    command -v Xorg >/dev/null || missing+=("Xorg with the dummy driver")
    command -v weston >/dev/null || missing+=("Weston, for windows on Wayland")
    for library in libX11.so.6 libX11-xcb.so.1 libXcursor.so.1 libXi.so.6 libxkbcommon.so.0 libxkbcommon-x11.so.0; do
        [[ $libraries == *"$library"* ]] || missing+=("$library, for windows")
    done
    command -v cc >/dev/null || missing+=("a C linker (cc), which Rust links with")
    headers() { echo '#include <vulkan/vk_icd.h>' | cc -E - >/dev/null 2>&1; }
    headers || missing+=("the headers of Vulkan (vulkan/vk_icd.h), for tools/posing.sh")
fi
((${#missing[@]})) || exit 0
say "this system has no apt-get; please install:"
printf '  - %s\n' "${missing[@]}" >&2
exit 1
