#include "client/cli/command.h"

int main(int argc, char** argv) { return deform::cli::run(argc, argv); }
