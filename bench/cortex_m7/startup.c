/* A Cortex-M7 from its reset on to the start of newlib, whose files are those of the machine around it (semihosting). */
extern void _start(void);
extern char top_of_stack[];

__attribute__((naked, noreturn)) void reset(void) {
    *(volatile unsigned *) 0xE000ED88u |= 0xFu << 20; /* the floating-point unit is off at first */
    __asm volatile("dsb\n isb\n b _start");
}

__attribute__((section(".vectors"), used)) static const void *const vectors[] = {top_of_stack, (const void *) reset};
