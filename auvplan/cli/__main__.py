from auvplan.cli import main

main()
