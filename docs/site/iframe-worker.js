// The theme searches in a worker, and browsers refuse workers to pages that were opened from disk. There, and only
// there, a worker's script runs in a hidden frame, and the ends of a channel take the places of worker and page: what
// is sent is copied, comes later, and waits for the script, as with a worker. But the page stands still meanwhile.
// The theme's plugin "offline" looks for this file's name, and then leaves out the one from another machine.
"use strict";

if (location.protocol === "file:") {
  window.Worker = function (address) {
    const { port1: worker, port2: page } = new MessageChannel();
    const frame = document.createElement("iframe");
    frame.hidden = true;
    // Older versions of Firefox load the empty document only later, in place of the one that is there at first.
    frame.addEventListener("load", () => {
      const scope = frame.contentWindow;
      scope.postMessage = (data) => page.postMessage(data);
      const script = scope.document.createElement("script");
      script.src = new URL(address, document.baseURI).href;
      script.addEventListener("load", () => {
        page.onmessage = ({ data }) => scope.dispatchEvent(new MessageEvent("message", { data }));
      });
      scope.document.head.append(script);
    }, { once: true });
    document.body.append(frame);
    worker.start(); // whoever adds listeners to a worker does not start it
    return worker;
  };
}
