/** Live images of the camera: loaded only while the page is seen and the view shows them. */

import { setAttribute, show } from "./dom.js";

const URL_LIVE = "/api/preview.mjpeg";
const RETRY_MS = 2000;

/**
 * Preview in an <img>. `frame` gets the image's aspect ratio, `absent` is shown while there is no image.
 */
export class Preview {
  constructor(image, frame, absent) {
    this.image = image;
    this.frame = frame;
    this.absent = absent;
    this.wanted = false;
    this.retry = null;
    image.addEventListener("error", () => this.#failed());
    image.addEventListener("load", () => show(this.absent, !this.live));
    document.addEventListener("visibilitychange", () => this.#apply());
  }

  /** Load the live images from now on, or no longer. `camera` is that of the snapshot. */
  set(wanted, camera) {
    this.wanted = wanted && Boolean(camera);
    if (camera?.width && camera?.height) this.frame.style.aspectRatio = `${camera.width} / ${camera.height}`;
    this.#apply();
  }

  /** True if an image is on screen. */
  get live() {
    return this.image.hasAttribute("src") && this.image.naturalWidth > 0;
  }

  #apply() {
    const load = this.wanted && !document.hidden;
    if (load && !this.image.hasAttribute("src") && this.retry === null)
      this.image.setAttribute("src", URL_LIVE);
    if (!load) setAttribute(this.image, "src", null);
    show(this.image, load && this.image.hasAttribute("src"));
    show(this.absent, !this.live);
  }

  #failed() {
    if (!this.image.hasAttribute("src")) return;
    setAttribute(this.image, "src", null);
    show(this.image, false);
    show(this.absent, true);
    this.retry = setTimeout(() => {
      this.retry = null;
      this.#apply();
    }, RETRY_MS);
  }
}
