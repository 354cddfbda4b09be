// The module as it lies in its file, in the program.
    .section .rodata
    .balign 16
    .global cloudrenderer_image_module_begin
    .hidden cloudrenderer_image_module_begin
cloudrenderer_image_module_begin:
    .incbin MODULE_FILE
    .global cloudrenderer_image_module_end
    .hidden cloudrenderer_image_module_end
cloudrenderer_image_module_end:
    .byte 0
    .section .note.GNU-stack,"",%progbits
