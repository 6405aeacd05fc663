// what scrolls by itself can be reached by the keyboard
addEventListener("load", () => {
    for (const part of document.querySelectorAll("pre, .math-wrapper, .table-wrapper"))
        if (part.scrollWidth > part.clientWidth || part.scrollHeight > part.clientHeight)
            part.tabIndex = 0;
});
